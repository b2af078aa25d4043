"""Checks of plugins: whether one keeps the rules of its kind."""

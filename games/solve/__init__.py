"""Solvers of games: equilibria, their certificates, responses and information."""

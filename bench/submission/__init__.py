"""Submissions: pack, choose what to repeat, verify."""

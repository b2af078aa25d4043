"""Equilibria of scenarios, solved once and kept."""

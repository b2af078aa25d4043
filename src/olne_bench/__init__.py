"""OLNE Bench: a benchmark for inverse dynamic games."""

"""Sensors by name: one class per file, whose ``layers`` are those of ``games.model.sensor``."""

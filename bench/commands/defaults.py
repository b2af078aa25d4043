"""Defaults that help shows and commands use."""

from pathlib import Path

#: Folder of submissions.
SUBMISSIONS = Path("results/submissions")
#: Planners of a drive and its salt.
PLANNERS = ("oracle", "map", "kkt_constrained", "uniform", "constant_velocity", "stock", "ppo")
DRIVING_SALT = "driving"

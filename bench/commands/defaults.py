"""Defaults that help shows and commands use."""

from pathlib import Path

#: Folder of submissions.
SUBMISSIONS = Path("results/submissions")

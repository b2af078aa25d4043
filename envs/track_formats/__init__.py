"""Formats of track files, one module each, named after the format.

A format is a module with a ``DESCRIPTION`` of one line and a function
``read(path, part) -> envs.tracks.table.Tracks``, where ``part`` names one part of a file in which
player names repeat, or is None. Put a new file into this folder and ``olne-bench import`` knows it.
"""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Protocol, cast

from olne_bench.envs.tracks.table import Tracks
from olne_bench.errors import UserError


class TrackFormat(Protocol):
    """A module for one format."""

    DESCRIPTION: str

    def read(self, path: Path, part: str | None) -> Tracks:
        """Read in metres, seconds, radians, centres of cars; UserError on a wrong file or part."""


def format_names() -> list[str]:
    """Names of all formats."""
    return sorted(module.name for module in iter_modules(__path__))


def get_format(name: str) -> TrackFormat:
    """The format with a name; the message of UserError lists the known ones."""
    if name not in format_names():
        raise UserError(f"unknown format {name!r}; known are: {', '.join(format_names())}")
    return cast(TrackFormat, import_module(f"{__name__}.{name}"))

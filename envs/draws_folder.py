"""The folder of kept equilibria of played draws, apart from modules that are slow to import."""

from pathlib import Path

from olne_bench.games.compiler import kept_folder


def draws_folder() -> Path | None:
    """The folder, whether or not it exists; None if nothing can be kept."""
    libraries = kept_folder()
    return libraries and libraries.with_name(f"{libraries.name}-draws")

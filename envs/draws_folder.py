"""Where equilibria of played draws are kept, apart from what is slow to import."""

from pathlib import Path

from olne_bench.games.compiler import kept_folder


def draws_folder() -> Path | None:
    """The folder, be it there or not; None where nothing can be kept."""
    libraries = kept_folder()
    return libraries and libraries.with_name(f"{libraries.name}-draws")

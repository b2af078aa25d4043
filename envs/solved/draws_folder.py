"""Folders of solved draws, apart from modules that are slow to import."""

from pathlib import Path

from olne_bench.games.compiled.compiler import kept_folder

#: Suffix of files of solved draws.
DRAWS_SUFFIX = ".draws"
#: The draws that come with this package; so written, fingerprints of code cover them.
_SHIPPED = Path("draws/*.draws")


def draws_folder() -> Path | None:
    """The folder, whether or not it exists; None if nothing can be kept."""
    libraries = kept_folder()
    return libraries and libraries.with_name(f"{libraries.name}-draws")


def shipped_draws() -> Path:
    """The folder of the draws that come with suites of this package, one file each."""
    return Path(__file__).parent / _SHIPPED.parent

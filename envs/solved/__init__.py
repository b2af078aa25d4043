"""Equilibria of scenarios, solved once and kept: in files that travel, and in a user's folder."""

from pathlib import Path

from olne_bench.kept_files import KeptFiles

#: Suffix of files of solved draws.
DRAWS_SUFFIX = ".draws"
#: The draws that come with this package; so written, fingerprints of code cover them.
_SHIPPED = Path("draws/*.draws")
#: What a user has played in worlds, some ten kilobytes each (``envs.solved.kept_draws``).
KEPT_DRAWS = KeptFiles("-draws", most_bytes=20_000_000)


def shipped_draws() -> Path:
    """The folder of the draws that come with suites of this package, one file each."""
    return Path(__file__).parent / _SHIPPED.parent

"""The file of a suite's solved draws (``envs.solved.draws_file``): where and which one it is."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from olne_bench.bench.plan.suite import Suite, salt_id
from olne_bench.envs.solved import DRAWS_SUFFIX, shipped_draws
from olne_bench.envs.solved.draws_file import Draws, OtherDrawsError, read_draws


@dataclass(frozen=True)
class DrawsSource:
    """A file of draws, as processes and machines of a run find it."""

    place: str  # absolute path, or the name of a suite whose file comes with this package
    digest: str  # SHA-256 as hexadecimal text

    @property
    def path(self) -> Path:
        """Where the file is on this machine."""
        if self.place.endswith(DRAWS_SUFFIX):
            return Path(self.place)
        return draws_path(self.place)


def draws_path(reference: str) -> Path:
    """The place of a suite's draws: beside its TOML file, or in this package."""
    if reference.endswith(".toml"):
        return Path(reference).with_suffix(DRAWS_SUFFIX)
    return shipped_draws() / f"{reference}{DRAWS_SUFFIX}"


def about(suite: Suite) -> dict[str, str]:
    """What a file of draws says of its suite; the salt itself stays secret."""
    return {"suite": suite.name, "salt_id": salt_id(suite.salt)}


def draws_of(reference: str, suite: Suite) -> Draws | None:
    """The draws of a suite; None if there is no file, or one for another salt.

    OtherDrawsError if the file is damaged, or of another version or suite.
    """
    path = draws_path(reference)
    if not path.exists():
        return None
    draws, own = read_draws(path), about(suite)
    if draws.about.get("suite") != suite.origin:
        raise OtherDrawsError(
            f"draws file {path} is of suite {draws.about.get('suite')!r}, not {suite.origin!r}"
        )
    return draws if draws.about.get("salt_id") == own["salt_id"] else None


def draws_source(reference: str, suite: Suite) -> DrawsSource | None:
    """The source of ``draws_of``, for trials."""
    draws = draws_of(reference, suite)
    if draws is None:
        return None
    own = reference.endswith(".toml")
    return DrawsSource(str(draws_path(reference).resolve()) if own else reference, draws.digest)


@lru_cache(maxsize=2)
def opened(source: DrawsSource | None) -> Draws | None:
    """The draws of a source, which is read once per process.

    It must be the file that the run was started with (OtherDrawsError).
    """
    if source is None:
        return None
    draws = read_draws(source.path)
    if draws.digest != source.digest:
        raise OtherDrawsError(
            f"draws file {draws.place} has the hash {draws.digest[:12]} in the worker and "
            f"{source.digest[:12]} where the run was started"
        )
    return draws

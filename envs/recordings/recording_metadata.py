"""Metadata of a recording file, as checked data."""

from importlib.metadata import version
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from olne_bench.envs.tracks.road_file import RoadFile

_PACKAGES = ("olne-bench", "numpy", "casadi", "pettingzoo", "highway-env", "pyarrow")


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class GainsEntry(_Strict):
    """``games.solve.olne.Gains`` as plain numbers."""

    gains: list[float]
    starts: list[int]
    passed: bool


class CertificateEntry(_Strict):
    """``games.solve.olne.Certificate`` as plain numbers.

    Attributes:
        gains: largest gain of each player in any search.
        costs: each player's cost.
        tolerance: allowed gain relative to 1 + |cost|.
        passed: whether every search passed.
        local: gains by nearby plans; None in older files, whose ``gains`` are these.
        global_so_far: gains by plans far away; None if they were not looked for.
    """

    gains: list[float]
    costs: list[float]
    tolerance: float
    passed: bool
    local: GainsEntry | None = None
    global_so_far: GainsEntry | None = None


class EpisodeEntry(_Strict):
    """What is known about one episode.

    Attributes:
        players: names of the N players.
        seed: seed of the draw; None for tracks.
        weights: (N, K) true weights; None for tracks.
        certificate: evidence of the equilibrium; None for tracks.
        road: lanes and the players' targets, as far as known.
    """

    players: list[str] = Field(min_length=1)
    seed: int | None = None
    weights: list[list[float]] | None = None
    certificate: CertificateEntry | None = None
    road: RoadFile | None = None


class Metadata(_Strict):
    """What is known about a whole file.

    Attributes:
        kind: ``truth`` for a world's equilibria, ``tracks`` for motion of unknown weights.
        scenario: name of the scenario; for tracks, that of their road file or None.
        options: the scenario's own options.
        weight_names: names of the K weights; None for tracks.
        state_names: names of the n state components.
        control_names: names of the m control components; none for tracks.
        dt: step [s].
        versions: versions of this package and the libraries that it ran on.
        episodes: one entry each.
    """

    kind: Literal["truth", "tracks"]
    scenario: str | None = None
    options: dict[str, Any] = {}
    weight_names: list[str] | None = None
    state_names: list[str]
    control_names: list[str] = []
    dt: float = Field(gt=0, strict=True)
    versions: dict[str, str]
    episodes: list[EpisodeEntry] = Field(min_length=1)


def library_versions() -> dict[str, str]:
    """Versions of this package and of the libraries that shape a recording."""
    return {name: version(name) for name in _PACKAGES}

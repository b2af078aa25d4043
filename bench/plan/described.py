"""What stands in for sensors and metrics until they are plugins in folders of their own."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import olne_bench
from olne_bench import plugins
from olne_bench.games.observation import VIEWS
from olne_bench.plugins import METRIC, SENSOR, Description, Kind

_METRICS = ("cosine_error", "covered", "held_out_error", "position_error", "reconstruction_error")
_MODULES = {
    "sensor": "olne_bench.games.observation",
    "metric": "olne_bench.bench.judge.metrics",
}


def names(kind: Kind) -> list[str]:
    """As ``plugins.names``."""
    stand_in = {SENSOR: list(VIEWS), METRIC: list(_METRICS)}
    return plugins.names(kind) or stand_in[kind]


def describe(kind: Kind | None, reference: str, parameters: Mapping[str, Any]) -> Description:
    """As ``plugins.describe``."""
    if kind is None or plugins.names(kind) or reference.endswith(".py"):
        return plugins.describe(kind, reference, parameters)
    if reference not in names(kind):
        error = f"unknown {kind.name} {reference!r}; known are: {', '.join(names(kind))}"
        return Description(kind.name, reference, error=error)
    gated = reference in ("cosine_error", "position_error")
    return Description(kind.name, reference, reference, declaration={"gated": gated})


def source(kind: Kind, reference: str) -> tuple[str, Path]:
    """As ``plugins.source``."""
    if plugins.names(kind) or plugins.is_file(reference):
        return plugins.source(kind, reference)
    module = _MODULES[kind.name]
    place = Path(str(olne_bench.__file__)).parents[1].joinpath(*module.split("."))
    return module, place.with_suffix(".py")

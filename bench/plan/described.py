"""What plugins say of themselves, asked in this process."""

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import olne_bench
from olne_bench.envs.scenarios import check_options, is_family, scenario_options
from olne_bench.errors import UserError
from olne_bench.estimators.registry import (
    EstimatorError,
    absolute_reference,
    estimator_label,
    estimator_source,
    is_file_reference,
    load_estimator,
)
from olne_bench.games.observation import VIEWS

_METRICS = {
    "cosine_error": {"label": "cosine error", "unit": "", "needs_prediction": False},
    "position_error": {"label": "position error", "unit": "m", "needs_prediction": True},
    "held_out_error": {"label": "held-out error", "unit": "m", "needs_prediction": True},
    "covered": {"label": "covered", "unit": "", "needs_prediction": False},
    "reconstruction_error": {"label": "reconstruction", "unit": "m", "needs_prediction": False},
}
METRICS = tuple(_METRICS)


@dataclass(frozen=True)
class Description:
    kind: str
    reference: str
    label: str = ""
    parameters: tuple[str, ...] = ()
    family: bool = False
    several: bool = False
    declaration: dict[str, Any] = field(default_factory=dict)
    error: str = ""


def describe(kind: str | None, reference: str, parameters: Mapping[str, Any]) -> Description:
    kind = kind or "estimator"
    try:
        return _describe(kind, reference, parameters)
    except (TypeError, ValueError, UserError, EstimatorError) as error:
        prefix = f"{kind} {reference!r} refuses its options: " * isinstance(error, TypeError)
        return Description(kind, reference, error=f"{prefix}{error}")


def _describe(kind: str, reference: str, parameters: Mapping[str, Any]) -> Description:
    if kind == "scenario":
        check_options(reference, **parameters)
        names = tuple(scenario_options(reference))
        return Description(kind, reference, reference, names, family=is_family(reference))
    if kind == "sensor":
        if reference not in VIEWS:
            raise UserError(f"unknown sensor {reference!r}; known are: {', '.join(VIEWS)}")
        return Description(kind, reference, reference)
    if kind == "metric":
        if reference not in _METRICS:
            raise UserError(f"unknown metric {reference!r}; known are: {', '.join(_METRICS)}")
        gated = reference in ("cosine_error", "position_error")
        declaration = {**_METRICS[reference], "gated": gated, "compared": gated}
        return Description(kind, reference, reference, declaration=declaration)
    made = load_estimator(reference, parameters)
    several = bool(getattr(made, "several", False))
    label, absolute = estimator_label(reference), absolute_reference(reference)
    return Description(kind, absolute, label, several=several)


def is_file(reference: str) -> bool:
    return is_file_reference(reference)


def source(kind: str, reference: str) -> tuple[str, Path]:
    if kind == "estimator":
        return estimator_source(reference)
    modules = {
        "scenario": f"olne_bench.envs.scenarios.{reference}",
        "sensor": "olne_bench.games.observation",
        "metric": "olne_bench.bench.judge.metrics",
    }
    place = Path(str(olne_bench.__file__)).parents[1].joinpath(*modules[kind].split("."))
    return modules[kind], place.with_suffix(".py")


def backend() -> str:
    compiled = os.environ.get("OLNE_BENCH_NATIVE", "1") != "0"
    return "native" if compiled and shutil.which(os.environ.get("CC", "cc")) else "numpy"

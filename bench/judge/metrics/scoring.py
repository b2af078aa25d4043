"""All metrics of a trial, one after the other."""

import math
import numbers
from collections.abc import Iterable
from typing import Any

import numpy as np

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.judged import Judged
from olne_bench.bench.text import one_line


class MetricError(Exception):
    """A metric failed. This is a fault of the harness, never of the estimator."""


def score_all(metrics: Iterable[Any], case: Judged) -> dict[str, float | None]:
    """Every metric's value, a finite number, by the metric's name; None where it does not apply.

    Metrics are objects with ``name`` and ``score``; one that needs a prediction is skipped without.

    Raises:
        MetricError: in one line that names the metric, if it raises or returns anything else.
    """
    scores: dict[str, float | None] = {}
    for metric in metrics:
        declared = declare(metric)
        if declared.needs_prediction and case.prediction is None:
            scores[declared.name] = None
            continue
        try:
            value = _number(metric.score(case))
        except BaseException as error:  # a metric may be foreign code: SystemExit is its fault, too
            raise MetricError(_complaint(declared.name, error)) from error
        scores[declared.name] = value
    return scores


def _number(value: Any) -> float | None:
    if value is None:
        return None
    if isinstance(value, np.generic | np.ndarray) and value.ndim == 0:
        value = value.item()
    if not isinstance(value, numbers.Real):
        raise TypeError(f"it returned a {type(value).__name__}, expected a number or None")
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"it returned {number}, expected a finite number or None")
    return number


def _complaint(name: str, error: BaseException) -> str:
    try:
        text = str(error)
    except Exception:  # an exception class may be foreign code too
        text = "no text"
    return one_line(f"metric {name!r}: {type(error).__name__}: {text}")

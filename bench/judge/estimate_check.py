"""Whether what an estimator returned is an estimate."""

import contextlib
import json
import math
import numbers
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from olne_bench.bench.text import one_line
from olne_bench.estimators.protocol import Problem

#: How far a covariance may be from symmetric and positive semi-definite, over its largest entry.
COVARIANCE_TOLERANCE = 1e-6
#: Scalar extras that a trial keeps, and the longest text among them.
MOST_EXTRAS = 20
_LONGEST_TEXT = 200
_LARGEST_INTEGER = 2**63
#: Row sums within these are safe to divide by.
_SMALLEST_SUM, _LARGEST_SUM = 1e-290, 1e290


class InvalidEstimateError(Exception):
    """An estimator returned something that is not an estimate."""


@dataclass(frozen=True)
class CheckedEstimate:
    """What an estimator returned, well-formed.

    Attributes:
        weights: (N, K), rows sum to one.
        states: (T, N, n) or None.
        covariance: (N*K, N*K) of weights so scaled, or None.
        converged: as in ``Estimate``.
        message: one line.
        objective: out of the extras, or None.
        extras: JSON text of the other extras that are finite numbers, truth values or short texts,
            the first ``MOST_EXTRAS`` by name.
    """

    weights: np.ndarray
    states: np.ndarray | None
    covariance: np.ndarray | None
    converged: bool
    message: str
    objective: float | None
    extras: str | None


def check_estimate(result: Any, problem: Problem) -> CheckedEstimate:
    """Read an estimate attribute by attribute, as plugins need not use our class.

    Raises:
        InvalidEstimateError: on one that is not an estimate of the problem.
    """
    if result is None:
        raise InvalidEstimateError("returned NoneType without 'weights'")
    weights = _weights(result, (problem.game.num_players, problem.game.num_weights))
    extras = _extras(result)
    return CheckedEstimate(
        weights=weights,
        states=_states(result, problem.game.state_shape),
        covariance=_covariance(result, weights.size),
        converged=_converged(result),
        message=_message(result),
        objective=_objective(extras),
        extras=_scalars(extras),
    )


def _read(result: Any, name: str) -> Any:
    """An optional attribute; None where it is absent."""
    try:
        return getattr(result, name, None)
    except Exception as error:  # a property may be foreign code too
        raise InvalidEstimateError(
            f"{name} cannot be read: {type(error).__name__}: {error}"
        ) from error


def _weights(result: Any, expected: tuple[int, int]) -> np.ndarray:
    given = _read(result, "weights")
    if given is None and not hasattr(result, "weights"):
        raise InvalidEstimateError(f"returned {type(result).__name__} without 'weights'")
    weights = _as_array("weights", given)
    if weights.shape != expected:
        raise InvalidEstimateError(f"weights have the shape {weights.shape}, expected {expected}")
    if not np.isfinite(weights).all():
        raise InvalidEstimateError("weights are not finite")
    if (weights < 0).any():
        raise InvalidEstimateError(f"weights are negative: the least is {weights.min():g}")
    largest = weights.max(axis=1, keepdims=True)
    if (largest <= 0).any():
        raise InvalidEstimateError("a player's weights are all zero")
    with np.errstate(over="ignore"):
        totals = weights.sum(axis=1, keepdims=True)
    safe = (totals > _SMALLEST_SUM) & (totals < _LARGEST_SUM)
    weights = weights / np.where(safe, 1.0, largest)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _states(result: Any, expected: tuple[int, int, int]) -> np.ndarray | None:
    given = _read(result, "states")
    if given is None:
        return None
    states = _as_array("states", given)
    if states.shape != expected:
        raise InvalidEstimateError(f"states have the shape {states.shape}, expected {expected}")
    if not np.isfinite(states).all():
        raise InvalidEstimateError("states are not finite")
    return states


def _covariance(result: Any, size: int) -> np.ndarray | None:
    given = _read(result, "covariance")
    if given is None:
        return None
    covariance = _as_array("covariance", given)
    if covariance.shape != (size, size):
        raise InvalidEstimateError(
            f"covariance has the shape {covariance.shape}, expected {(size, size)}"
        )
    if not np.isfinite(covariance).all():
        raise InvalidEstimateError("covariance is not finite")
    scale = np.abs(covariance).max()
    if scale > 0:
        scaled = covariance / scale
        asymmetry = np.abs(scaled - scaled.T).max()
        if asymmetry > COVARIANCE_TOLERANCE:
            raise InvalidEstimateError(
                f"covariance is not symmetric: entries differ from their mirror images by up to "
                f"{asymmetry:.2g} of the largest"
            )
        least = np.linalg.eigvalsh((scaled + scaled.T) / 2)[0]
        if least < -COVARIANCE_TOLERANCE:
            raise InvalidEstimateError(
                f"covariance is not positive semi-definite: its least eigenvalue is "
                f"{least * scale:.2g}, its largest entry {scale:.2g}"
            )
    return covariance


def _converged(result: Any) -> bool:
    given = _scalar(_read(result, "converged"))
    if given is None and not hasattr(result, "converged"):
        return True
    if isinstance(given, int) and given in (0, 1):
        return bool(given)
    raise InvalidEstimateError(f"converged is {_short(given)}, expected True or False")


def _message(result: Any) -> str:
    given = _read(result, "message")
    if given is None:
        return ""
    if not isinstance(given, str | bytes):
        raise InvalidEstimateError(f"message is {_short(given)}, expected a text")
    return one_line(given if isinstance(given, str) else given.decode(errors="replace"))


def _extras(result: Any) -> Mapping[Any, Any]:
    given = _read(result, "extras")
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InvalidEstimateError(f"extras are {_short(given)}, expected a mapping by name")
    try:
        return dict(given)
    except Exception as error:  # a mapping may be foreign code too
        raise InvalidEstimateError(
            f"extras cannot be read: {type(error).__name__}: {error}"
        ) from error


def _objective(extras: Mapping[Any, Any]) -> float | None:
    given = _scalar(extras.get("objective"))
    if given is None:
        return None
    if isinstance(given, numbers.Real) and not isinstance(given, bool):
        with contextlib.suppress(OverflowError):
            return float(given)
    raise InvalidEstimateError(f"extras['objective'] is {_short(given)}, expected a number")


def _scalars(extras: Mapping[Any, Any]) -> str | None:
    kept: dict[str, str | float] = {}
    for name in sorted(name for name in extras if isinstance(name, str) and name != "objective"):
        value = _scalar(extras[name])
        if isinstance(value, str) and len(value) <= _LONGEST_TEXT:
            kept[one_line(name)] = one_line(value)
        elif (isinstance(value, int) and abs(value) < _LARGEST_INTEGER) or (
            isinstance(value, float) and math.isfinite(value)
        ):
            kept[one_line(name)] = value
    first = dict(list(kept.items())[:MOST_EXTRAS])
    return json.dumps(first, sort_keys=True) if first else None


def _scalar(value: Any) -> Any:
    """NumPy's scalars and arrays of no dimension as Python's own."""
    return value.item() if isinstance(value, np.generic | np.ndarray) and value.ndim == 0 else value


def _short(value: Any) -> str:
    """A value for a message."""
    try:
        text = one_line(repr(value))
    except Exception:  # foreign code
        text = ""
    return text if 0 < len(text) <= 60 else f"a {type(value).__name__}"


def _as_array(what: str, value: Any) -> np.ndarray:
    verb = "is" if what == "covariance" else "are"
    try:
        array = np.asarray(value)
        if array.dtype.kind in "cSUmMV":
            raise TypeError(f"its type is {array.dtype}")
        return np.asarray(array, dtype=float)
    except Exception as error:  # a sequence may be foreign code too
        raise InvalidEstimateError(f"{what} {verb} not an array of numbers: {error}") from error

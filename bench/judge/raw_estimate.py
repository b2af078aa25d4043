"""An estimate as plain data, as a player process sends it to the referee.

``read_estimate`` runs in the player process, as attributes and sequences may be foreign code too.
The referee does not trust what it receives, and checks it (``judge.estimate_check``).
"""

import contextlib
import math
import numbers
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from olne_bench.bench.process.messages import Array, pack
from olne_bench.bench.text import clip, one_line

#: Number of scalar extras that a trial keeps, and the length of the longest text.
MOST_EXTRAS = 20
LONGEST_EXTRA = 200
LARGEST_INTEGER = 2**63


class InvalidEstimateError(Exception):
    """An estimator returned something that is not an estimate."""


class RawEstimate(msgspec.Struct, forbid_unknown_fields=True):
    """An estimate on its way to the referee: arrays as returned, or None."""

    weights: Array
    states: Array | None
    covariance: Array | None
    parameters: Array | None
    parameter_deviations: Array | None
    converged: bool
    message: str  # one line
    objective: float | None  # ``extras["objective"]``
    #: the first ``MOST_EXTRAS`` others by name that are finite numbers, booleans or short texts
    extras: dict[str, bool | int | float | str]
    region: str | None = None
    samples: Array | None = None
    parameter_samples: Array | None = None


def read_estimate(result: Any) -> RawEstimate:
    """Read an estimate attribute by attribute, as plugins need not use our class.

    The error names the attribute that cannot be read or is of a wrong type.
    """
    if result is None:
        raise InvalidEstimateError("returned NoneType without 'weights'")
    weights = _array(result, "weights")
    if weights is None:
        if not _has(result, "weights"):
            raise InvalidEstimateError(f"returned {type(result).__name__} without 'weights'")
        raise InvalidEstimateError("weights are None, expected an array of numbers")
    extras = _extras(result)
    return RawEstimate(
        weights=weights,
        states=_array(result, "states"),
        covariance=_array(result, "covariance"),
        region=_region(result),
        parameters=_array(result, "parameters"),
        parameter_deviations=_array(result, "parameter_deviations"),
        converged=_converged(result),
        message=_message(result),
        objective=_objective(extras),
        extras=_scalars(extras),
        samples=_array(result, "samples"),
        parameter_samples=_array(result, "parameter_samples"),
    )


def _read(result: Any, name: str) -> Any:
    """An optional attribute; None where it is absent."""
    try:
        return getattr(result, name, None)
    except Exception as error:  # a property may be foreign code too
        raise InvalidEstimateError(
            f"{name} cannot be read: {type(error).__name__}: {error}"
        ) from error


def _region(result: Any) -> str | None:
    value = _read(result, "region")
    if value is None:
        return None
    if not isinstance(value, str):
        raise InvalidEstimateError(f"region is a {type(value).__name__}, expected a text")
    return clip(value)


def _has(result: Any, name: str) -> bool:
    try:
        return hasattr(result, name)
    except Exception:
        return True  # there is something, even if it cannot be read


def _array(result: Any, name: str) -> Array | None:
    value = _read(result, name)
    if value is None:
        return None
    verb = "is" if name == "covariance" else "are"
    try:
        array = np.asarray(value)
        if array.dtype.kind in "cSUmMV":
            raise TypeError(f"its type is {array.dtype}")
        return pack(np.asarray(array, dtype=float))
    except Exception as error:  # a sequence may be foreign code too
        raise InvalidEstimateError(f"{name} {verb} not an array of numbers: {error}") from error


def _converged(result: Any) -> bool:
    given = _scalar(_read(result, "converged"))
    if given is None and not _has(result, "converged"):
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
    return clip(given if isinstance(given, str) else given.decode(errors="replace"))


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


def _scalars(extras: Mapping[Any, Any]) -> dict[str, bool | int | float | str]:
    kept: dict[str, bool | int | float | str] = {}
    for name in sorted(name for name in extras if isinstance(name, str) and name != "objective"):
        value = _scalar(extras[name])
        if isinstance(value, str) and len(value) <= LONGEST_EXTRA:
            kept[clip(name)] = one_line(value)
        elif is_plain_number(value):
            kept[clip(name)] = value
    return dict(list(kept.items())[:MOST_EXTRAS])


def is_plain_number(value: Any) -> bool:
    """Whether a value is a finite number that a table can keep."""
    if isinstance(value, int):
        return abs(value) < LARGEST_INTEGER
    return isinstance(value, float) and math.isfinite(value)


def _scalar(value: Any) -> Any:
    """NumPy scalars and zero-dimensional arrays as Python scalars."""
    return value.item() if isinstance(value, np.generic | np.ndarray) and value.ndim == 0 else value


def _short(value: Any) -> str:
    """A short text of a value, for messages."""
    try:
        text = one_line(repr(value))
    except Exception:  # foreign code
        text = ""
    return text if 0 < len(text) <= 60 else f"a {type(value).__name__}"

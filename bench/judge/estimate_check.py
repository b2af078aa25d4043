"""Check that the answer of a player is an estimate of the problem."""

import json
from dataclasses import dataclass

import numpy as np

from olne_bench.bench.judge.raw_estimate import (
    LONGEST_EXTRA,
    MOST_EXTRAS,
    InvalidEstimateError,
    RawEstimate,
    is_plain_number,
)
from olne_bench.bench.process.messages import Array, unpack
from olne_bench.bench.text import clip
from olne_bench.estimators.protocol import Problem

#: How far a covariance may be from symmetric and positive semi-definite, as a share of its
#: largest entry.
COVARIANCE_TOLERANCE = 1e-6
#: Row sums within these are safe to divide by.
_SMALLEST_SUM, _LARGEST_SUM = 1e-290, 1e290


@dataclass(frozen=True)
class CheckedEstimate:
    """A well-formed estimate.

    Attributes:
        weights: (N, K), rows sum to one.
        states: (T, N, n) or None.
        covariance: (N*K, N*K) of weights whose rows sum to one, or None.
        converged: as in ``Estimate``.
        message: one line.
        objective: what the estimator minimised, or None.
        extras: JSON text of its other scalar extras, or None.
    """

    weights: np.ndarray
    states: np.ndarray | None
    covariance: np.ndarray | None
    converged: bool
    message: str
    objective: float | None
    extras: str | None


def check_estimate(raw: RawEstimate, problem: Problem) -> CheckedEstimate:
    """Check an estimate and scale its weights.

    Raises:
        InvalidEstimateError: if it is not an estimate of the problem.
    """
    game = problem.game
    weights = _weights(raw.weights, (game.num_players, game.num_weights))
    return CheckedEstimate(
        weights=weights,
        states=_finite("states", raw.states, game.state_shape),
        covariance=_covariance(raw.covariance, weights.size),
        converged=raw.converged,
        message=clip(raw.message),
        objective=raw.objective,
        extras=_extras(raw),
    )


def _weights(given: Array, expected: tuple[int, int]) -> np.ndarray:
    weights = _finite("weights", given, expected)
    assert weights is not None
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


def _finite(name: str, given: Array | None, expected: tuple[int, ...]) -> np.ndarray | None:
    if given is None:
        return None
    verb, has = ("is", "has") if name == "covariance" else ("are", "have")
    try:
        array = unpack(given)
    except ValueError as error:
        raise InvalidEstimateError(f"{name} {verb} not an array of numbers: {error}") from error
    if array.shape != expected:
        raise InvalidEstimateError(f"{name} {has} the shape {array.shape}, expected {expected}")
    if not np.isfinite(array).all():
        raise InvalidEstimateError(f"{name} {verb} not finite")
    return array


def _covariance(given: Array | None, size: int) -> np.ndarray | None:
    covariance = _finite("covariance", given, (size, size))
    if covariance is None:
        return None
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


def _extras(raw: RawEstimate) -> str | None:
    for name, value in raw.extras.items():
        known = len(value) <= LONGEST_EXTRA if isinstance(value, str) else is_plain_number(value)
        if not known or len(raw.extras) > MOST_EXTRAS:
            raise InvalidEstimateError(f"extras[{clip(name)!r}] is more than a trial keeps")
    if not raw.extras:
        return None
    return json.dumps({clip(name): value for name, value in raw.extras.items()}, sort_keys=True)

"""Check that the answer of a player is an estimate of the problem."""

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
from olne_bench.estimators.protocol import COVARIANCE, REGIONS, SAMPLES, Estimate, Problem
from olne_bench.games.model.game import Game

#: How far a covariance may be from symmetric and positive semi-definite, as a share of its
#: largest entry.
COVARIANCE_TOLERANCE = 1e-6
#: Samples that an estimate may have: a 95 % quantile needs some, and a table is not to be filled.
FEWEST_SAMPLES, MOST_SAMPLES = 40, 4000

#: Row sums within these are safe to divide by.
_SMALLEST_SUM, _LARGEST_SUM = 1e-290, 1e290


def check_estimate(raw: RawEstimate, problem: Problem) -> Estimate:
    """The estimate of a player: shapes fit the problem, rows of weights and samples sum to one.

    What stands for nothing in arrays of unknowns is zero, and texts have one line. Raises
    ``InvalidEstimateError`` if it is not an estimate of the problem.
    """
    game = problem.game
    shape = (game.num_players, game.num_weights)
    weights = _scaled("weights", _array("weights", raw.weights, shape))
    samples = _samples(raw, shape)
    return Estimate(
        weights=weights,
        states=_read("states", raw.states, game.state_shape),
        covariance=_covariance(raw.covariance, weights.size),
        region=_region(raw),
        parameters=_parameters(raw, game),
        parameter_deviations=_deviations(raw.parameter_deviations, game),
        converged=raw.converged,
        message=clip(raw.message),
        extras=_extras(raw),
        samples=samples,
        parameter_samples=_parameter_samples(raw, game, samples),
    )


def _scaled(name: str, weights: np.ndarray) -> np.ndarray:
    """Weights (..., K) with row sums of one."""
    if (weights < 0).any():
        raise InvalidEstimateError(f"{name} are negative: the least is {weights.min():g}")
    largest = weights.max(axis=-1, keepdims=True)
    if (largest <= 0).any():
        which = "a player's weights" if name == "weights" else f"{name} of a player"
        raise InvalidEstimateError(f"{which} are all zero")
    with np.errstate(over="ignore"):
        totals = weights.sum(axis=-1, keepdims=True)
    safe = (totals > _SMALLEST_SUM) & (totals < _LARGEST_SUM)
    weights = weights / np.where(safe, 1.0, largest)
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))


def _samples(raw: RawEstimate, shape: tuple[int, int]) -> np.ndarray | None:
    if raw.samples is None:
        return None
    given = raw.samples.shape
    if given[1:] != shape:
        expected = f"(M, {shape[0]}, {shape[1]})"
        raise InvalidEstimateError(f"samples have the shape {given}, expected {expected}")
    samples, count = _array("samples", raw.samples, given), given[0]
    if not FEWEST_SAMPLES <= count <= MOST_SAMPLES:
        raise InvalidEstimateError(
            f"there are {count} samples, expected {FEWEST_SAMPLES} to {MOST_SAMPLES}"
        )
    return _scaled("samples", samples)


def _parameter_samples(
    raw: RawEstimate, game: Game, samples: np.ndarray | None
) -> np.ndarray | None:
    if raw.parameter_samples is None or not game.parameters.count:
        return None
    if samples is None:
        raise InvalidEstimateError("parameter_samples belong to samples, which are missing")
    return _of_unknowns("parameter_samples", raw.parameter_samples, game, len(samples))


def _read(name: str, given: Array | None, shape: tuple[int, ...]) -> np.ndarray | None:
    """An array of finite numbers of this shape; None if there is none."""
    return None if given is None else _array(name, given, shape)


def _array(
    name: str, given: Array, shape: tuple[int, ...], used: np.ndarray | None = None
) -> np.ndarray:
    """An array of finite numbers of this shape, with zeros where columns are not used."""
    verb, has = ("is", "has") if name == "covariance" else ("are", "have")
    try:
        array = unpack(given)
    except ValueError as error:
        raise InvalidEstimateError(f"{name} {verb} not an array of numbers: {error}") from error
    if array.shape != shape:
        raise InvalidEstimateError(f"{name} {has} the shape {array.shape}, expected {shape}")
    if used is not None:
        array = np.where(used, array, 0.0)
    if not np.isfinite(array).all():
        raise InvalidEstimateError(f"{name} {verb} not finite")
    return array


def _of_unknowns(name: str, given: Array, game: Game, *more: int) -> np.ndarray:
    """(N, U), or (*more, N, U), with zeros in the columns that stand for nothing."""
    used = game.parameters.used
    return _array(name, given, (*more, *used.shape), used)


def _covariance(given: Array | None, size: int) -> np.ndarray | None:
    covariance = _read("covariance", given, (size, size))
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


def _region(raw: RawEstimate) -> str | None:
    given = {SAMPLES: raw.samples is not None, COVARIANCE: raw.covariance is not None}
    kind = raw.region or next((name for name, there in given.items() if there), None)
    if kind is None:
        return None
    if kind not in REGIONS:
        raise InvalidEstimateError(f"region is {kind!r}, known are {', '.join(REGIONS)}")
    if not given.get(kind, True):
        raise InvalidEstimateError(f"region is {kind!r}, but there is no {kind}")
    return kind


def _parameters(raw: RawEstimate, game: Game) -> np.ndarray | None:
    known, given = game.parameters, raw.parameters
    if not known.count or (given is None and not raw.converged):
        return None
    if given is None:
        names = ", ".join(sorted({one.name for own in known.unknowns for one in own}))
        raise InvalidEstimateError(f"parameters are missing: the game has unknowns ({names})")
    values = _of_unknowns("parameters", given, game)
    for i, own in enumerate(known.unknowns):
        for unknown, value in zip(own, values[i], strict=False):
            if not unknown.low <= value <= unknown.high:
                raise InvalidEstimateError(
                    f"parameters: {unknown.name} of player {i} is {value:g} {unknown.unit}, the "
                    f"range is {unknown.low:g} to {unknown.high:g}"
                )
    return values


def _deviations(given: Array | None, game: Game) -> np.ndarray | None:
    if given is None or not game.parameters.count:
        return None
    values = _of_unknowns("parameter_deviations", given, game)
    if (values < 0).any():
        raise InvalidEstimateError(
            f"parameter_deviations are negative: the least is {values.min():g}"
        )
    return values


def _extras(raw: RawEstimate) -> dict[str, bool | int | float | str]:
    for name, value in raw.extras.items():
        known = len(value) <= LONGEST_EXTRA if isinstance(value, str) else is_plain_number(value)
        if not known or len(raw.extras) > MOST_EXTRAS:
            raise InvalidEstimateError(f"extras[{clip(name)!r}] is more than a trial keeps")
    objective = {} if raw.objective is None else {"objective": raw.objective}
    return {clip(name): value for name, value in sorted(raw.extras.items())} | objective

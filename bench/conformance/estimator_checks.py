"""Rules of estimators, as checks."""

import pickle
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from olne_bench.bench.conformance import NonConformance, Weakness
from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.bench.judge.observe import observe, sensor_model
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError, read_estimate
from olne_bench.bench.run.player import describe_problem
from olne_bench.envs.recordings.recording import Recording, record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.incoming_samples import as_stream_estimator, warm_up_stream
from olne_bench.games.model.observation import VIEWS

#: Largest cosine error that still counts as a recovery from noise-free data.
RECOVERY = 1e-3

_SIGMA = 0.01
#: Samples of a motion that goes on, and how many of them count.
_SAMPLES, _LAG = 8, 6


@dataclass(frozen=True)
class _Case:
    problem: Problem
    observation: Observation
    weights: np.ndarray


def _shapes(estimator: Any, budget: float) -> None:
    """Weights (N, K) on the simplex after scaling, states and covariance of the right shape."""
    for case in _supported(estimator):
        _valid(_estimate(estimator, case, budget), case.problem)


def _determinism(estimator: Any, budget: float) -> None:
    """Its only source of randomness is the generator that it is given."""
    case = _supported(estimator)[0]
    first = _weights(estimator, case, budget)
    np.random.seed(1)  # noqa: NPY002 (an estimator that uses it must not get away with it)
    second = _weights(estimator, case, budget)
    _require_equal(first, second, "two estimates with equal generators differ")


def _pickling(estimator: Any, budget: float) -> None:
    """A copy through pickle gives the same estimate, which can be pickled as well."""
    case = _supported(estimator)[0]
    before = _weights(estimator, case, budget)
    try:
        copy = pickle.loads(pickle.dumps(estimator))
    except Exception as error:
        raise NonConformance(f"it cannot be pickled: {error}") from error
    _require_equal(before, _weights(copy, case, budget), "a pickled copy gives other weights")


def _inputs(estimator: Any, budget: float) -> None:
    """It changes neither problem nor observation."""
    case = _supported(estimator)[0]
    seen = case.observation
    extra = None if seen.extra is None else seen.extra.copy()
    kept, problem = Observation(seen.y.copy(), extra), describe_problem("", case.problem)
    _estimate(estimator, case, budget)
    for name in ("y", "extra"):
        if not np.array_equal(getattr(kept, name), getattr(seen, name), equal_nan=True):
            raise NonConformance(f"it writes into observation.{name}: work on a copy")
    if describe_problem("", case.problem) != problem:
        raise NonConformance("it changes the problem")


def _deadline(estimator: Any, budget: float) -> None:
    """An estimate takes less than its budget, even with five players and much noise."""
    case = _case("highway_overtaking", "full", 0.1)
    if _declines(estimator, case.problem):
        case = _supported(estimator)[0]
    _warm_up(estimator, case.problem)
    started = time.monotonic()
    _estimate_only(estimator, case, budget)
    seconds = time.monotonic() - started
    if seconds > budget:
        raise NonConformance(f"it took {seconds:.2f} s of a budget of {budget:g} s")


def _missing(estimator: Any, budget: float) -> None:
    """It copes with missing samples (NaN), or says that it cannot."""
    case = _supported(estimator)[0]
    y = case.observation.y.copy()
    y[3, 0] = np.nan
    y[10:13, 1, 0] = np.nan
    y[-1, -1] = np.nan
    gappy = _Case(case.problem, Observation(y, case.observation.extra), case.weights)
    result = _estimate(estimator, gappy, budget)
    if getattr(result, "converged", True) or not getattr(result, "message", ""):
        _valid(result, case.problem)


def _supports(estimator: Any, budget: float) -> None:
    """It can estimate what ``supports`` accepts; reasons are texts, and always the same."""
    for case in _cases():
        reason = _declines(estimator, case.problem)
        if reason != _declines(estimator, case.problem):
            raise NonConformance("supports() gives two answers to one problem")
        if reason is not None and not isinstance(reason, str):
            raise NonConformance(f"supports() returned {reason!r}: a reason is a str, or None")
        if not reason:
            try:
                _valid(_estimate(estimator, case, budget), case.problem)
            except (Exception, SystemExit) as error:
                players, view = case.problem.game.num_players, case.problem.view.name
                raise NonConformance(
                    f"supports() accepts {players} players in the {view} view, but then: "
                    f"{type(error).__name__}: {error}"
                ) from error
    _supported(estimator)


def _streams(estimator: Any, budget: float) -> None:
    """It follows a motion sample by sample, as in a study of streams, until the budget is spent."""
    case = _supported(estimator)[0]
    game = replace(case.problem.game, horizon=_SAMPLES)
    problem = replace(case.problem, game=game)
    if _declines(estimator, problem):
        return
    for lag in (None, _LAG):
        warm_up_stream(estimator, problem, lag)
        rng = np.random.default_rng(0)
        stream = as_stream_estimator(estimator).start(problem, rng=rng, lag=lag)
        began = time.monotonic()
        for sample in case.observation.y[:_SAMPLES]:
            result = stream.update(sample.copy(), budget=budget)
            if getattr(result, "converged", True):
                _valid(result, problem)
            if time.monotonic() - began > budget:
                break


def _recovery(estimator: Any, budget: float) -> None:
    """It finds the true weights of two players without noise."""
    cases = [_case("random", view, 0.0, 2, seed) for view in VIEWS for seed in (0, 1)]
    for case in [c for c in cases if not _declines(estimator, c.problem)][:2]:
        error = cosine_error(case.weights, _weights(estimator, case, budget))
        if error > RECOVERY:
            raise Weakness(
                f"the cosine error of its weights is {error:.2g} without noise, that of a good "
                f"estimator at most {RECOVERY:g}"
            )


#: Checks by name, in the order in which they run.
CHECKS: dict[str, Callable[[Any, float], None]] = {
    "shapes and simplex": _shapes,
    "determinism under a fixed rng": _determinism,
    "pickling": _pickling,
    "inputs are not mutated": _inputs,
    "deadline is kept": _deadline,
    "missing samples": _missing,
    "supports() is honest": _supports,
    "follows a motion": _streams,
    "recovers a noise-free toy": _recovery,
}


def _case(
    scenario: str, view: str, sigma: float, num_players: int | None = None, seed: int = 0
) -> _Case:
    recording = _recording(scenario, num_players, seed)
    layers = (VIEWS[view],)
    scale = sensor_model(recording.scenario, layers).noise_scale
    return _Case(
        problem=Problem(recording.scenario.game, VIEWS[view], sigma, noise_scale=scale),
        observation=observe([recording], layers, sigma, seed)[0],
        weights=recording.scenario.weights,
    )


@lru_cache(maxsize=8)
def _recording(scenario: str, num_players: int | None, seed: int) -> Recording:
    sized = {} if num_players is None else {"num_players": num_players}
    return record(get_scenario(scenario, seed, **sized))


def _cases() -> list[_Case]:
    games = (("two_player", None), ("random", 3))
    return [_case(name, view, _SIGMA, count) for name, count in games for view in VIEWS]


def _supported(estimator: Any) -> list[_Case]:
    cases = [case for case in _cases() if not _declines(estimator, case.problem)]
    if not cases:
        reason = _declines(estimator, _case("two_player", "full", _SIGMA).problem)
        raise NonConformance(f"supports() accepts no problem, not even two players: {reason}")
    return cases


def _declines(estimator: Any, problem: Problem) -> Any:
    return estimator.supports(problem) if hasattr(estimator, "supports") else None


def _warm_up(estimator: Any, problem: Problem) -> None:
    if hasattr(estimator, "warm_up"):
        estimator.warm_up(problem)


def _estimate(estimator: Any, case: _Case, budget: float) -> Any:
    _warm_up(estimator, case.problem)
    return _estimate_only(estimator, case, budget)


def _estimate_only(estimator: Any, case: _Case, budget: float) -> Any:
    rng = np.random.default_rng(0)
    return estimator.estimate(case.problem, case.observation, rng=rng, budget=budget)


def _weights(estimator: Any, case: _Case, budget: float) -> np.ndarray:
    return _valid(_estimate(estimator, case, budget), case.problem)


def _valid(result: Any, problem: Problem) -> np.ndarray:
    try:
        estimate = check_estimate(read_estimate(result), problem)
    except InvalidEstimateError as error:
        raise NonConformance(str(error)) from error
    return estimate.weights


def _require_equal(first: np.ndarray, second: np.ndarray, finding: str) -> None:
    if not np.array_equal(first, second):
        raise NonConformance(f"{finding}, by up to {np.abs(first - second).max():.2g}")

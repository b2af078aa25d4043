"""Run one trial: play the scenario, observe it, estimate, judge the estimate."""

import time
import traceback
import zlib
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from bench.metrics import cosine_error, position_error
from bench.sensor import sense
from bench.suite import ScenarioEntry
from bench.trial import Outcome, Trial
from envs.recording import NoEquilibriumError, Recording, record
from envs.scenarios import get_scenario, is_family
from estimators.protocol import Observation, Problem
from estimators.registry import load_estimator
from games.information import cosine_error_limit, weight_covariance
from games.nearest_root import nearest_root
from games.observation import VIEWS, FullView, View, observe


class InvalidEstimateError(Exception):
    """An estimator returned something that is not an estimate."""


@dataclass(frozen=True)
class _CheckedEstimate:
    weights: np.ndarray
    states: np.ndarray | None
    converged: bool
    message: str
    objective: float | None


def evaluate(trial: Trial) -> Outcome:
    """Run a trial in this process.

    An estimator's exceptions become an outcome. Its hanging or dying does not: that is for the
    executor to see to.
    """
    view = VIEWS[trial.view]
    try:
        recording = _recording(trial.scenario.name, _options(trial.scenario), trial.seed)
    except NoEquilibriumError as error:
        return Outcome("skipped", str(error))
    scenario = recording.scenario
    problem = Problem(scenario.game, view, trial.sigma)
    observation = _read_only(sense(recording, view, trial.sigma, trial.seed))
    facts = {
        "observation_error": _observation_error(recording, trial),
        "truth_objective": _squared_error(recording, view, observation),
        "cosine_limit": _cosine_limit(trial, recording, view),
    }

    estimator = load_estimator(trial.estimator.name, trial.estimator.parameters)
    try:
        reason = estimator.supports(problem) if hasattr(estimator, "supports") else None
        if reason:
            return Outcome("skipped", _one_line(str(reason)), **facts)
        if hasattr(estimator, "warm_up"):
            estimator.warm_up(problem)
        rng = np.random.default_rng(zlib.crc32(repr(trial.key).encode()))
        started = time.perf_counter()
        result = estimator.estimate(problem, observation, rng=rng, budget=trial.time_limit)
        facts["solve_seconds"] = time.perf_counter() - started
    except Exception as error:
        return Outcome("crash", _describe(error), **facts)

    try:
        estimate = _check(result, problem)
    except InvalidEstimateError as error:
        return Outcome("invalid", str(error), **facts)
    return _judge(estimate, recording, facts)


def _judge(estimate: _CheckedEstimate, recording: Recording, facts: dict[str, Any]) -> Outcome:
    """Score a well-formed estimate; its success is defined as in the published study."""
    scenario = recording.scenario
    facts["cosine_error"] = cosine_error(scenario.weights, estimate.weights)
    facts["weights"] = estimate.weights.tolist()
    facts["objective"] = estimate.objective
    if estimate.states is not None:
        facts["reconstruction_error"] = position_error(recording.states, estimate.states)
    if not estimate.converged:
        return Outcome("not_converged", estimate.message or "no reason given", **facts)
    root = nearest_root(scenario.game, estimate.weights, recording.states, recording.controls)
    if root is None:
        return Outcome("failed_forward", "no root of the game at the estimated weights", **facts)
    facts["position_error"] = position_error(recording.states, root.states)
    return Outcome("ok", estimate.message, **facts)


def _check(result: Any, problem: Problem) -> _CheckedEstimate:
    """Read an estimate attribute by attribute, as plugins need not use our class."""
    if not hasattr(result, "weights"):
        raise InvalidEstimateError(f"returned {type(result).__name__} without 'weights'")
    weights = _as_array("weights", result.weights)
    expected = (problem.game.num_players, problem.game.num_weights)
    if weights.shape != expected:
        raise InvalidEstimateError(f"weights have the shape {weights.shape}, expected {expected}")
    if not np.isfinite(weights).all():
        raise InvalidEstimateError("weights are not finite")
    if (weights < 0).any():
        raise InvalidEstimateError(f"weights are negative: the least is {weights.min():g}")
    if (weights.sum(axis=1) <= 0).any():
        raise InvalidEstimateError("a player's weights are all zero")

    states = getattr(result, "states", None)
    if states is not None:
        states = _as_array("states", states)
        if states.shape != problem.game.state_shape:
            raise InvalidEstimateError(
                f"states have the shape {states.shape}, expected {problem.game.state_shape}"
            )
        if not np.isfinite(states).all():
            raise InvalidEstimateError("states are not finite")
    objective = (getattr(result, "extras", None) or {}).get("objective")
    return _CheckedEstimate(
        weights=weights / weights.sum(axis=1, keepdims=True),
        states=states,
        converged=bool(getattr(result, "converged", True)),
        message=_one_line(str(getattr(result, "message", ""))),
        objective=None if objective is None else float(objective),
    )


def _as_array(what: str, value: Any) -> np.ndarray:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidEstimateError(f"{what} are not an array of numbers: {error}") from error


def _options(scenario: ScenarioEntry) -> tuple[tuple[str, Any], ...]:
    return tuple(sorted(scenario.options.items()))


def _recording(name: str, options: tuple[tuple[str, Any], ...], seed: int) -> Recording:
    return _cached_recording(name, options, seed if is_family(name) else 0)


@lru_cache(maxsize=32)
def _cached_recording(name: str, options: tuple[tuple[str, Any], ...], seed: int) -> Recording:
    return record(get_scenario(name, seed, **dict(options)))


def _cosine_limit(trial: Trial, recording: Recording, view: View) -> float | None:
    seed = trial.seed if is_family(trial.scenario.name) else 0
    unit = _unit_limit(trial.scenario.name, _options(trial.scenario), seed, view)
    return None if unit is None else trial.sigma**2 * unit


@lru_cache(maxsize=64)
def _unit_limit(
    name: str, options: tuple[tuple[str, Any], ...], seed: int, view: View
) -> float | None:
    recording = _cached_recording(name, options, seed)
    scenario = recording.scenario
    covariance = weight_covariance(
        scenario.game,
        view,
        recording.states,
        recording.controls,
        recording.costates,
        scenario.weights,
    )
    return None if covariance is None else cosine_error_limit(covariance, scenario.weights)


def _observation_error(recording: Recording, trial: Trial) -> float:
    seen = sense(recording, FullView(), trial.sigma, trial.seed)
    return position_error(recording.states, seen.y)


def _squared_error(recording: Recording, view: View, observation: Observation) -> float:
    expected = observe(view, recording.scenario.game.dynamics, recording.states)
    return float(np.nansum((expected - observation.y) ** 2))


def _read_only(observation: Observation) -> Observation:
    """An estimator that writes into its input gets an exception and so a row of its own."""
    for array in (observation.y, observation.extra):
        if array is not None:
            array.setflags(write=False)
    return observation


def _describe(error: Exception) -> str:
    place = traceback.extract_tb(error.__traceback__)[-1]
    return _one_line(f"{type(error).__name__}: {error} ({place.filename}:{place.lineno})")


def _one_line(text: str) -> str:
    return " ".join(text.split())

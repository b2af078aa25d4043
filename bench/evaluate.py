"""Run one trial: play the scenario, observe it, estimate, judge the estimate."""

import time
import traceback
import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.metrics import cosine_error, covered, position_error
from bench.sensor import sense
from bench.trial import Outcome, Trial
from bench.truth import (
    held_out_error,
    observed_noise_scale,
    predict_from_start,
    true_recordings,
    unit_cosine_limit,
)
from envs.recording import NoEquilibriumError, Recording
from estimators.protocol import Observation, Problem
from estimators.registry import load_estimator
from games.observation import VIEWS, FullView, observe


class InvalidEstimateError(Exception):
    """An estimator returned something that is not an estimate."""


@dataclass(frozen=True)
class CheckedEstimate:
    """What an estimator returned, well-formed; weights (N, K) with rows that sum to one.

    The covariance is that of weights so scaled.
    """

    weights: np.ndarray
    states: np.ndarray | None
    covariance: np.ndarray | None
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
        recordings = true_recordings(trial.scenario, trial.seed)
        limit = unit_cosine_limit(trial.scenario, trial.seed, view)
    except NoEquilibriumError as error:
        return Outcome("skipped", str(error))
    recording = recordings[0]
    scale = observed_noise_scale(recording.scenario, view)
    problem = Problem(recording.scenario.game, view, trial.sigma, noise_scale=tuple(scale))
    observations = tuple(
        _read_only(sense(one, view, trial.sigma, trial.seed, k)) for k, one in enumerate(recordings)
    )
    outcome = Outcome(
        status="ok",
        observation_error=_observation_error(recording, trial),
        truth_objective=sum(
            _squared_error(one, problem, seen)
            for one, seen in zip(recordings, observations, strict=True)
        ),
        cosine_limit=None if limit is None else trial.sigma**2 * limit,
    )

    try:
        estimator = load_estimator(trial.estimator.name, trial.estimator.parameters)
        reason = estimator.supports(problem) if hasattr(estimator, "supports") else None
        if len(observations) > 1 and not getattr(estimator, "several", False):
            reason = f"takes one trajectory at a time, not {len(observations)}"
        if reason:
            return replace(outcome, status="skipped", message=_one_line(str(reason)))
        if hasattr(estimator, "warm_up"):
            estimator.warm_up(problem)
        rng = np.random.default_rng(zlib.crc32(repr(trial.key).encode()))
        started = time.perf_counter()
        observation = observations if len(observations) > 1 else observations[0]
        result = estimator.estimate(problem, observation, rng=rng, budget=trial.time_limit)
        outcome = replace(outcome, solve_seconds=time.perf_counter() - started)
    except (Exception, SystemExit) as error:
        return replace(outcome, status="crash", message=describe_error(error))

    try:
        estimate = check_estimate(result, problem)
    except InvalidEstimateError as error:
        return replace(outcome, status="invalid", message=_one_line(str(error)))
    return _judge(estimate, trial, recording, outcome)


def _judge(
    estimate: CheckedEstimate, trial: Trial, recording: Recording, outcome: Outcome
) -> Outcome:
    """Score a well-formed estimate."""
    scenario = recording.scenario
    outcome = replace(
        outcome,
        message=estimate.message,
        cosine_error=cosine_error(scenario.weights, estimate.weights),
        weights=estimate.weights.tolist(),
        objective=estimate.objective,
    )
    if estimate.covariance is not None and trial.sigma > 0:
        inside = covered(scenario.weights, estimate.weights, estimate.covariance)
        outcome = replace(outcome, covered=None if inside is None else int(inside))
    if estimate.states is not None:
        error = position_error(recording.states, estimate.states)
        outcome = replace(outcome, reconstruction_error=error)
    if not estimate.converged:
        message = estimate.message or "the estimator gives no reason"
        return replace(outcome, status="not_converged", message=message)
    prediction = predict_from_start(
        trial.scenario, trial.seed, estimate.weights, trial.root_iterations
    )
    outcome = replace(outcome, published_forward=int(prediction.published))
    if prediction.root is None:
        message = "no root of the game found at the estimated weights"
        return replace(outcome, status="failed_forward", message=message)
    error = position_error(recording.states, prediction.root.states)
    return replace(outcome, position_error=error, held_out_error=_held_out(trial, estimate.weights))


def _held_out(trial: Trial, weights: np.ndarray) -> float | None:
    try:
        return held_out_error(trial.scenario, trial.seed, weights, trial.root_iterations)
    except NoEquilibriumError:  # nothing near this draw to predict
        return None


def check_estimate(result: Any, problem: Problem) -> CheckedEstimate:
    """Read an estimate attribute by attribute, as plugins need not use our class.

    Raises:
        InvalidEstimateError: on one that is not an estimate of the problem.
    """
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
    covariance = getattr(result, "covariance", None)
    if covariance is not None:
        covariance = _as_array("covariance", covariance)
        if covariance.shape != (weights.size, weights.size):
            raise InvalidEstimateError(
                f"covariance has the shape {covariance.shape}, "
                f"expected {(weights.size, weights.size)}"
            )
        if not np.isfinite(covariance).all():
            raise InvalidEstimateError("covariance is not finite")
    objective = (getattr(result, "extras", None) or {}).get("objective")
    return CheckedEstimate(
        weights=weights / weights.sum(axis=1, keepdims=True),
        states=states,
        covariance=covariance,
        converged=bool(getattr(result, "converged", True)),
        message=_one_line(str(getattr(result, "message", ""))),
        objective=None if objective is None else float(objective),
    )


def _as_array(what: str, value: Any) -> np.ndarray:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidEstimateError(f"{what} are not an array of numbers: {error}") from error


def _observation_error(recording: Recording, trial: Trial) -> float:
    seen = sense(recording, FullView(), trial.sigma, trial.seed)
    return position_error(recording.states, seen.y)


def _squared_error(recording: Recording, problem: Problem, observation: Observation) -> float:
    expected = observe(problem.view, recording.scenario.game.dynamics, recording.states)
    return float(np.nansum(((expected - observation.y) / problem.noise_scale) ** 2))


def _read_only(observation: Observation) -> Observation:
    """An estimator that writes into its input gets an exception and so a row of its own."""
    for array in (observation.y, observation.extra):
        if array is not None:
            array.setflags(write=False)
    return observation


def describe_error(error: BaseException) -> str:
    """One line: what was raised, and where."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return _one_line(f"{type(error).__name__}: {error} ({place.filename}:{place.lineno})")


def _one_line(text: str) -> str:
    return " ".join(text.split())

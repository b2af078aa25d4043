"""Run one trial: play the scenario, observe it, estimate, judge the estimate."""

import time
import traceback
import zlib
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import numpy as np

from olne_bench.bench.judge.differences import find_change
from olne_bench.bench.judge.estimate_check import (
    CheckedEstimate,
    InvalidEstimateError,
    check_estimate,
)
from olne_bench.bench.judge.metrics import cosine_error, covered, position_error
from olne_bench.bench.judge.observe import observe, squared_error
from olne_bench.bench.judge.truth import (
    held_out_error,
    observed_noise_scale,
    predict_from_start,
    true_recordings,
    unit_cosine_limit,
)
from olne_bench.bench.plan.trial import Outcome, Trial
from olne_bench.bench.text import one_line
from olne_bench.envs.recording import NoEquilibriumError, Recording
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.registry import load_estimator
from olne_bench.games.observation import VIEWS, FullView


def no_stages(name: str) -> None:
    """Takes the names of stages, for nobody."""


def evaluate(trial: Trial, begin: Callable[[str], None] = no_stages) -> Outcome:
    """Run a trial in this process.

    Whatever an estimator raises becomes an outcome. Its hanging or dying does not: that is for the
    executor to see to.

    Args:
        trial: what to run.
        begin: told the name of each stage as it begins: set-up, estimate, scoring. Each of them has
            the trial's time limit for itself.
    """
    begin("set-up")
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
        _read_only(one) for one in observe(recordings, (view,), trial.sigma, trial.seed)
    )
    outcome = Outcome(
        status="ok",
        observation_error=_observation_error(recording, trial),
        truth_objective=sum(
            squared_error(problem, one.states, seen)
            for one, seen in zip(recordings, observations, strict=True)
        ),
        cosine_limit=None if limit is None else trial.sigma**2 * limit,
    )

    # The truth behind the problem is kept for other trials, so foreign code gets a copy.
    handed = deepcopy(problem) if trial.plugin else problem
    try:
        estimator = load_estimator(trial.estimator.name, trial.estimator.parameters)
        reason = estimator.supports(handed) if hasattr(estimator, "supports") else None
        if len(observations) > 1 and not getattr(estimator, "several", False):
            reason = f"takes one trajectory at a time, not {len(observations)}"
        if reason:
            return replace(outcome, status="skipped", message=one_line(str(reason)))
        if hasattr(estimator, "warm_up"):
            estimator.warm_up(handed)
        rng = np.random.default_rng(zlib.crc32(repr(trial.key).encode()))
        observation = observations if len(observations) > 1 else observations[0]
        begin("estimate")
        started = time.perf_counter()
        result = estimator.estimate(handed, observation, rng=rng, budget=trial.time_limit)
        outcome = replace(outcome, solve_seconds=time.perf_counter() - started)
    except BaseException as error:  # nobody else raises here: a worker does not hear of Ctrl-C
        return replace(outcome, status="crash", message=describe_error(error))

    begin("scoring")
    try:
        changed = find_change(problem, handed, "problem")
        if changed is not None:
            raise InvalidEstimateError(f"it changed the problem: {changed}")
        estimate = check_estimate(result, problem)
    except InvalidEstimateError as error:
        return replace(outcome, status="invalid", message=one_line(str(error)))
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
        extras=estimate.extras,
    )
    if estimate.covariance is not None and trial.sigma > 0:
        inside = covered(scenario.weights, estimate.weights, estimate.covariance)
        outcome = replace(outcome, covered=int(inside))
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


def _observation_error(recording: Recording, trial: Trial) -> float:
    (seen,) = observe([recording], (FullView(),), trial.sigma, trial.seed)
    return position_error(recording.states, seen.y)


def _read_only(observation: Observation) -> Observation:
    """An estimator that writes into its input gets an exception and so a row of its own."""
    for array in (observation.y, observation.extra):
        if array is not None:
            array.setflags(write=False)
    return observation


def describe_error(error: BaseException) -> str:
    """One line: what was raised, and where."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    try:
        text = str(error)
    except Exception:  # an exception class may be foreign code too
        text = "no text"
    return one_line(f"{type(error).__name__}: {text} ({place.filename}:{place.lineno})")

"""The referee judges trials: it plays a scenario, lets sensors observe, and scores an estimate.

Only the referee knows the truth. An estimator runs in another process (``judge.players``).
"""

import json
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.likelihood import likelihood_ratio, posterior_ratio
from olne_bench.bench.judge.metrics.judged import Judged, Once
from olne_bench.bench.judge.metrics.scoring import MetricError, score_all
from olne_bench.bench.judge.observe import layers_of, observe, observed, problem_of, sensor_model
from olne_bench.bench.judge.players import (
    ForeignMetrics,
    PlayerFault,
    PlayerTask,
    Staff,
    longest_seconds,
    own_seconds,
)
from olne_bench.bench.judge.priors import exclusion, prior_told
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError
from olne_bench.bench.judge.scene import pack_motion, pack_truth
from olne_bench.bench.judge.seeds import noise_seed, stream
from olne_bench.bench.judge.truth import (
    Draw,
    ahead,
    held_out,
    held_out_samples,
    predict_from_start,
    true_recordings,
    true_scene,
    unit_cosine_limit,
)
from olne_bench.bench.judge.weight_levels import weight_levels
from olne_bench.bench.plan.kinds import Rules
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.text import clip, describe_error
from olne_bench.envs.recordings.recording import NoEquilibriumError, Recording
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.shared.fit_test import Expected, expected_at, peak_near, residuals_at
from olne_bench.estimators.shared.forward_model import game_at, game_of_motion
from olne_bench.estimators.shared.noise_level import with_told_noise
from olne_bench.estimators.shared.posterior_density import density_near
from olne_bench.estimators.shared.white_noise import with_white_noise
from olne_bench.games.model.observation import FullView, View, whitening
from olne_bench.games.model.observation import observe as view_of
from olne_bench.games.model.sensor import Layer, SensorModel
from olne_bench.games.solve.newton import Root


@dataclass(frozen=True)
class Case:
    """The truth of a trial and its observations."""

    draw: Draw
    model: SensorModel  # what may be known of the sensor
    recordings: tuple[Recording, ...]  # the true motions, one for each trajectory
    problem: Problem  # what an estimator is told
    observations: tuple[Observation, ...]  # what it is shown
    outcome: Outcome  # the fields that are known before the estimate


def judge(trial: Trial, staff: Staff) -> Outcome:
    """Judge a trial; its stages after the set-up are estimate and scoring.

    What goes wrong outside the player is a ``harness_error``, never an estimator's failure.
    """
    try:
        case = case_of(trial)
    except NoEquilibriumError as error:
        return Outcome("skipped", clip(str(error)))
    except BaseException as error:  # a scenario or a sensor may be foreign code
        return Outcome("harness_error", f"set-up: {describe_error(error)}")
    outcome, scene = judge_case(trial, case, staff), _scene_once(trial, case)
    return outcome if scene is None else replace(outcome, scene=scene)


_sent: set[tuple[str, str, int]] = set()


def _scene_once(trial: Trial, case: Case) -> bytes | None:
    """What a store keeps of a draw and a sensor; None if this process has sent it already."""
    place = (trial.scenario.label, trial.sensor.label, case.draw.seed)
    if place in _sent:
        return None
    _sent.add(place)
    return pack_truth(true_scene(case.draw, case.model))


def judge_case(trial: Trial, case: Case, staff: Staff) -> Outcome:
    """Judge a trial whose truth and observations are known; arguments as of ``judge``."""
    excluded = exclusion(trial.estimator, case.recordings[0].scenario, case.problem.prior)
    if excluded:
        return replace(case.outcome, status="invalid", message=clip(excluded))
    staff.announce("estimate", longest_seconds(trial))
    seed, shown_to_it = stream(trial.salt, "estimator", *trial.key), case.observations
    task = PlayerTask.of(trial, case.problem, seed, observations=shown_to_it)
    try:
        answer = staff.player.estimate(task)
    except PlayerFault as fault:
        message = clip(str(fault))
        return replace(
            case.outcome, status=fault.status, message=message, solve_seconds=fault.seconds
        )
    if answer.declined is not None or answer.estimate is None:
        return replace(case.outcome, status="skipped", message=answer.declined or "")
    staff.announce("scoring", own_seconds(trial) + len(trial.metrics) * trial.time_limit)
    outcome = replace(case.outcome, solve_seconds=answer.seconds)
    try:
        estimate = check_estimate(answer.estimate, case.problem)
        return _scored(estimate, trial, case, outcome, staff.metrics)
    except InvalidEstimateError as error:
        return replace(outcome, status="invalid", message=clip(str(error)))
    except (Exception, SystemExit) as error:
        return replace(outcome, status="harness_error", message=f"scoring: {describe_error(error)}")


def case_of(trial: Trial) -> Case:
    """The truth of a trial and its observations; raises as ``case_at``."""
    draw = Draw.of(trial.scenario, trial.seed, trial.salt)
    return case_at(draw, layers_of(trial.sensor), trial)


def case_at(draw: Draw, layers: tuple[Layer, ...], trial: Trial) -> Case:
    """The case of a trial on a draw, or ``NoEquilibriumError`` without a certified equilibrium."""
    seed = noise_seed(trial.scenario, trial.sigma, trial.seed, trial.salt)
    problem, observations = shown(draw, layers, trial.sigma, seed)
    problem = _as_told(problem, draw, trial.rules)
    model, recordings = _model(draw, layers), true_recordings(draw)
    seen = [one.y for one in observations] if model.may_miss else None
    limit = unit_cosine_limit(draw, model, seen)
    outcome = Outcome(
        status="ok",
        observation_error=_observation_error(
            recordings[0], model, observations[0], trial.sigma, seed
        ),
        truth_objective=sum(
            _squared_error(expected, model, seen)
            for expected, seen in zip(_expected(draw, model.view), observations, strict=True)
        ),
        cosine_limit=None if limit is None else trial.sigma**2 * limit,
    )
    return Case(draw, model, recordings, problem, observations, outcome)


def _as_told(problem: Problem, draw: Draw, rules: Rules) -> Problem:
    """What estimators are told by the rules of a study, which may be wrong on purpose."""
    prior = prior_told(true_recordings(draw)[0].scenario, rules)
    spread = rules.noise_spread if problem.sigma else 0.0
    return replace(problem, prior=prior, sigma=rules.noise * problem.sigma, sigma_spread=spread)


def shown(
    draw: Draw, layers: tuple[Layer, ...], sigma: float, seed: int
) -> tuple[Problem, tuple[Observation, ...]]:
    """What an estimator is told and shown of a draw; sigma is in [m], the seed from ``noise_seed``.

    Raises ``NoEquilibriumError`` if the draw has no certified equilibrium.
    """
    recordings, model = true_recordings(draw), _model(draw, layers)
    scenario = recordings[0].scenario
    problem = problem_of(scenario.told, model, sigma, scenario.prior)
    return problem, observe(recordings, layers, sigma, seed)


def _scored(
    estimate: Estimate, trial: Trial, case: Case, outcome: Outcome, foreign: ForeignMetrics
) -> Outcome:
    """Score a well-formed estimate."""
    true_weights = case.recordings[0].scenario.weights
    levels = weight_levels(true_weights, estimate) if trial.sigma else None
    outcome = replace(
        outcome,
        message=estimate.message,
        weights=estimate.weights.tolist(),
        unknowns=_listed(estimate.parameters),
        weight_levels=_listed(levels),
        fit_p=fit_p(estimate, case),
        objective=estimate.extras.get("objective"),
        extras=_stored_extras(estimate),
    )
    judged = Judged(case.recordings, estimate, prediction=None, sigma=trial.sigma)
    if not estimate.converged:
        message = estimate.message or "the estimator gives no reason"
        outcome = replace(outcome, status="not_converged", message=message)
        return _with_scores(outcome, judged, trial, foreign)
    theta = estimate.theta(case.problem.game)
    prediction = predict_from_start(case.draw, theta, trial.root_iterations)
    outcome = replace(outcome, published_forward=int(prediction.published))
    if prediction.root is None:
        message = "no root of the game found at the estimated weights"
        outcome = replace(outcome, status="failed_forward", message=message)
        return _with_scores(outcome, judged, trial, foreign)
    outcome = replace(outcome, motion=pack_motion(prediction.root.states))
    judged = _with_prediction(judged, trial, case, prediction.root)
    return _with_scores(outcome, judged, trial, foreign)


def _with_prediction(judged: Judged, trial: Trial, case: Case, root: Root) -> Judged:
    """What metrics see of a trial whose forward game is known."""
    estimate, problem, found = judged.estimate, case.problem, (judged.estimate, root)
    theta = estimate.theta(problem.game)
    return replace(
        judged,
        prediction=root.states,
        held_out=partial(held_out, case.draw, theta, trial.root_iterations),
        held_out_samples=partial(_held_out_samples, case, trial, estimate),
        ahead=partial(ahead, case.draw, theta),
        likelihood_ratio=Once(
            partial(likelihood_ratio, problem, case.observations, case.recordings, *found)
        ),
        posterior_ratio=Once(
            partial(posterior_ratio, problem, case.observations[0], case.recordings[0], *found)
        ),
    )


def fit_p(estimate: Estimate, case: Case) -> float | None:
    """P-value of the fit test; its distribution is that at the true weights, which is kept."""
    if estimate.states is None or not case.problem.sigma:
        return None
    problem, (seen, *_) = with_white_noise(case.problem, case.observations)
    problem = with_told_noise(problem, estimate)
    theta = estimate.theta(problem.game)
    known = game_of_motion(problem.game, estimate.states, theta)
    peak = None if known is None else peak_near(problem, seen, known)
    expected = _expected_fit(case.draw, problem, np.isfinite(seen.y).tobytes())
    if peak is None or expected is None:
        return None
    level_known = not case.problem.sigma_spread
    return expected.test(residuals_at(peak, seen.y), level_known=level_known).p


@lru_cache(maxsize=32)
def _expected_fit(draw: Draw, problem: Problem, there: bytes) -> Expected | None:
    """What the fit test expects of the first trajectory; None at a fold of equilibria."""
    seen = np.frombuffer(there, dtype=bool).reshape(
        *problem.game.state_shape[:2], len(problem.noise_scale)
    )
    recording = true_recordings(draw)[0]
    expected = view_of(problem.view, problem.game.dynamics, recording.root.states)
    y = np.where(seen, expected, np.nan)
    game = game_at(problem.game, recording.root, recording.scenario.theta)
    place = density_near(problem, Observation(y), game.initial_state).place(game)
    return expected_at(place, seen) if place.possible[0] else None


def _stored_extras(estimate: Estimate) -> str | None:
    kept = {name: value for name, value in estimate.extras.items() if name != "objective"}
    return json.dumps(kept, sort_keys=True) if kept else None


def _listed(array: np.ndarray | None) -> list[list[float]] | None:
    return None if array is None else array.tolist()


def _with_scores(
    outcome: Outcome, judged: Judged, trial: Trial, foreign: ForeignMetrics
) -> Outcome:
    """The outcome with the scores of all metrics."""
    scores: dict[str, float | None] = {}
    notes = [outcome.message] if outcome.message else []
    for entry in trial.metrics:
        if plugins.is_built_in(plugins.METRIC, entry.name):
            metric = plugins.make(plugins.METRIC, entry.name, entry.parameters)
            scores[entry.column] = score_all([metric], judged)[metric.name]
        elif not (entry.declaration.get("needs_prediction") and judged.prediction is None):
            try:
                found = foreign.score(entry, judged, trial.home_plugins, trial.time_limit)
                scores[entry.column] = found
            except MetricError as error:  # concerns this metric only
                notes.append(clip(str(error)))
    return replace(outcome, scores=scores, message=clip("; ".join(notes)))


def _held_out_samples(case: Case, trial: Trial, estimate: Estimate, most: int) -> np.ndarray | None:
    game = case.problem.game
    samples = estimate.sampled_theta(game, most)
    if samples is None:
        return None
    return held_out_samples(case.draw, estimate.theta(game), samples, trial.root_iterations)


def _observation_error(
    recording: Recording, model: SensorModel, observation: Observation, sigma: float, seed: int
) -> float:
    """Mean absolute position noise [m] of the full state under the trial's noise."""
    names = model.view.component_names(recording.scenario.game.dynamics)
    y = observation.y
    if model.may_miss or not {"px", "py"} <= set(names):
        (full,) = observe((recording,), (FullView(),), sigma, seed)
        names, y = recording.scenario.game.dynamics.state_names, full.y
    places = [names.index("px"), names.index("py")]
    return float(np.mean(np.abs(recording.states[..., :2] - y[..., places])))


def _squared_error(expected: np.ndarray, model: SensorModel, observation: Observation) -> float:
    """Sum of squared observation errors of the true motion, whitened by the noise at sigma = 1."""
    root = _whitening(model.covariance)
    return float(np.nansum(((expected - observation.y) @ root.T) ** 2))


# A process judges trials of one draw and sensor in a row.


@lru_cache(maxsize=64)
def _model(draw: Draw, layers: tuple[Layer, ...]) -> SensorModel:
    return sensor_model(true_recordings(draw)[0].scenario, layers)


@lru_cache(maxsize=64)
def _expected(draw: Draw, view: View) -> tuple[np.ndarray, ...]:
    """(T, N, d) noise-free observations of each trajectory."""
    return tuple(observed(view, one)[:-1] for one in true_recordings(draw))


@lru_cache(maxsize=64)
def _whitening(covariance: tuple[tuple[float, ...], ...]) -> np.ndarray:
    return whitening(np.array(covariance))

"""Ground truth of scenarios, computed once per process."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from olne_bench.bench.judge.metrics.judged import HeldOut
from olne_bench.bench.judge.nearby_starts import follow_start, neighbours
from olne_bench.bench.judge.observe import Same
from olne_bench.bench.judge.scene import Quantity, TrueScene
from olne_bench.bench.judge.seeds import drawn_as, stream
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.envs.recordings.recording import Recording, record
from olne_bench.envs.roads.temperaments import checked_shares
from olne_bench.envs.scenarios import check_options, get_scenario
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.worlds.scene import is_on_road
from olne_bench.games.model.game import Game
from olne_bench.games.model.sensor import SensorModel
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.information import (
    cosine_error_limit,
    information_root,
    joint_weight_covariance,
    observation_sensitivity,
    of_seen,
    of_weights,
)
from olne_bench.games.solve.nearest_root import Prediction, predict
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import solve_olne
from olne_bench.plugins import SCENARIO, is_built_in

#: Number of other initial states from which predictions are judged.
HELD_OUT = 5
#: Rounds of best responses before a continuation counts as not found.
_ROUNDS = 30


@dataclass(frozen=True)
class Draw:
    """One member of a scenario family, or a fixed scenario."""

    name: str  # name or file of the scenario
    options: str  # of the scenario, as JSON
    trajectories: int  # how many
    seed: int  # a fixed scenario uses it for other starts only
    given: Same[Scenario] | None = None  # an object of this process that no name stands for

    @classmethod
    def of(cls, scenario: ScenarioEntry, seed: int, salt: str) -> "Draw":
        """The draw of a trial, which only those who know the salt can repeat."""
        options = json.dumps(scenario.options, sort_keys=True)
        name, drawn = drawn_as(scenario)
        key = (drawn, seed) if scenario.family else ()
        own = stream(salt, "draw", name, *key)
        return cls(scenario.name, options, scenario.trajectories, own)

    @classmethod
    def of_object(cls, scenario: Scenario) -> "Draw":
        """The only draw of a scenario that exists in this process only."""
        return cls(scenario.name, "{}", 1, 0, Same(scenario))


def true_recording(draw: Draw) -> Recording:
    """The true motion of a draw, or ``NoEquilibriumError`` without a certified equilibrium."""
    return _recording(draw.name, draw.options, draw.seed, draw.given)


def true_recordings(draw: Draw) -> tuple[Recording, ...]:
    """The true motions of a draw: from its own start and, for further trajectories, from others.

    Raises ``NoEquilibriumError`` where no certified equilibrium was found.
    """
    return (true_recording(draw), *_nearby(draw, draw.trajectories - 1, "trajectories"))


def held_out_recordings(draw: Draw) -> tuple[Recording, ...]:
    """The true motions from the nearby initial states from which predictions are judged.

    Raises ``NoEquilibriumError`` if there are too few certified equilibria nearby.
    """
    return _nearby(draw, HELD_OUT, "held out")


def held_out(draw: Draw, theta: np.ndarray, root_iterations: int) -> tuple[HeldOut, ...] | None:
    """Predictions from ``held_out_recordings``' states at theta (N, K + U).

    That of ``predict_from_start`` is followed to each state (``nearby_starts.follow_start``). None
    if there is none, if too few starts have an equilibrium, or if no root is found for one of them.
    """
    roots = _held_out_roots(draw, theta.tobytes(), root_iterations)
    if roots is None:
        return None
    pairs = zip(held_out_recordings(draw), roots, strict=True)
    return tuple(HeldOut(one.states, root.states) for one, root in pairs)


def held_out_samples(
    draw: Draw, theta: np.ndarray, samples: np.ndarray, root_iterations: int
) -> np.ndarray | None:
    """Predictions (H, M, T, N, n) from ``held_out``'s states at samples (M, N, K + U) of theta.

    They are followed from that at theta; NaN for a sample whose game is not found. None as in
    ``held_out``.
    """
    roots = _held_out_roots(draw, theta.tobytes(), root_iterations)
    if roots is None:
        return None
    game = true_recording(draw).scenario.told
    found = []
    for root in roots:
        try:
            batch = solve_batch(game, samples, root, theta)
        except ValueError:  # singular at the estimate
            return None
        found.append(np.where(batch.converged[:, None, None, None], batch.states, np.nan))
    return np.stack(found)


def predict_from_start(draw: Draw, theta: np.ndarray, root_iterations: int) -> Prediction:
    """The forward game at theta (N, K + U), from a draw's true initial state.

    Theta is what the scenario's ``told`` game leaves open: weights and standardised parameters. The
    latest predictions are cached, as some estimators return the same weights repeatedly.
    ``root_iterations`` is as in ``Suite``.
    """
    return _prediction(draw, theta.tobytes(), root_iterations)


def ahead(draw: Draw, theta: np.ndarray, seconds: float) -> tuple[np.ndarray, np.ndarray] | None:
    """What follows a draw's last true state: what happens, and what the game at theta predicts.

    Players plan as far ahead as in the game that was seen, or farther where more is asked. States
    (S+1, N, n) twice, the last true ones first; None where either is not found.
    """
    game = true_recording(draw).scenario.game
    steps = max(1, round(seconds / game.dt))
    horizon = max(game.horizon, steps + 1)
    follows, found = _continuation(draw, horizon), _foreseen(draw, theta.tobytes(), horizon)
    if follows is None or found is None:
        return None
    return follows[: steps + 1], found[: steps + 1]


def unit_cosine_limit(
    draw: Draw, model: SensorModel, seen: Sequence[np.ndarray] | None = None
) -> float | None:
    """Expected cosine error of an efficient estimator at sigma = 1; None if not identifiable.

    Multiply it by sigma^2 (``games.solve.information.cosine_error_limit``). Observations ``seen``
    (T, N, d) of each trajectory are needed if samples are missing.
    """
    if seen is None:
        return _unit_limit(draw, model)
    sensitivities = [
        of_seen(rows, y) for rows, y in zip(sensitivities_of(draw, model), seen, strict=True)
    ]
    return _limit(true_recording(draw), sensitivities)


@lru_cache(maxsize=64)
def sensitivities_of(draw: Draw, model: SensorModel) -> tuple[np.ndarray, ...]:
    """Sensitivity of each trajectory's observations, whitened by their noise.

    Raises ValueError if an equilibrium is singular, so that it is no function of the weights.
    """
    return tuple(
        observation_sensitivity(
            one.scenario.told,
            model.view,
            one.root.states,
            one.root.controls,
            one.root.costates,
            one.scenario.theta,
            noise_covariance=model.covariance,
        )
        for one in true_recordings(draw)
    )


def true_scene(draw: Draw, model: SensorModel) -> TrueScene:
    """What reports need of a draw and a sensor; raises as ``sensitivities_of``."""
    recording = true_recording(draw)
    scenario, told = recording.scenario, recording.scenario.told
    temperaments, shares = _drivers(draw)
    return TrueScene(
        road=scenario.name if is_on_road(scenario) else "",
        dt=scenario.game.dt,
        state_names=scenario.game.dynamics.state_names,
        weight_names=told.weight_names,
        noise_scale=scenario.noise_scale,
        states=recording.states,
        weights=scenario.weights,
        parameters=scenario.theta[:, :0] if scenario.parameters is None else scenario.parameters,
        unknowns=tuple(
            tuple(Quantity(one.name, one.unit, float(one.deviation)) for one in own)
            for own in told.parameters.unknowns
        ),
        information_root=information_root(told, sensitivities_of(draw, model)),
        temperaments=temperaments,
        shares=shares,
    )


def _drivers(draw: Draw) -> tuple[tuple[str, ...], dict[str, float]]:
    """Temperaments of a draw's drivers and the shares of its traffic, where there are any."""
    if draw.given is not None or not is_built_in(SCENARIO, draw.name):
        return (), {}
    family: Any = check_options(draw.name, **json.loads(draw.options))
    names = family.temperaments(draw.seed) if hasattr(family, "temperaments") else ()
    return names, checked_shares(family.shares) if names else {}


@lru_cache(maxsize=64)
def _recording(name: str, options: str, seed: int, given: Same[Scenario] | None) -> Recording:
    if given is not None:
        return record(given.it)
    return record(get_scenario(name, seed, **json.loads(options)))


@lru_cache(maxsize=64)
def _nearby(draw: Draw, count: int, purpose: str) -> tuple[Recording, ...]:
    return neighbours(true_recording(draw), count, purpose, seed=draw.seed)


@lru_cache(maxsize=64)
def _continuation(draw: Draw, horizon: int) -> np.ndarray | None:
    """What players do from a draw's last state on, (T, N, n); None where that is not found."""
    recording = true_recording(draw)
    scenario, last = recording.scenario, recording.states[-1]
    if scenario.departure is None:
        return _goes_on(scenario.game, scenario.weights, last, horizon)
    everybody = last if recording.everybody is None else recording.everybody
    try:
        return scenario.departure.driven(everybody, horizon)[:, : len(last)]
    except NoEquilibriumError:
        return None


@lru_cache(maxsize=8)
def _foreseen(draw: Draw, theta: bytes, horizon: int) -> np.ndarray | None:
    """What the told game at theta (N, K + U) expects from there on, as ``_continuation``."""
    recording = true_recording(draw)
    game, shape = recording.scenario.told, recording.scenario.theta.shape
    weights, unknown = np.split(np.frombuffer(theta).reshape(shape), [game.num_weights], axis=1)
    if game.parameters.count:
        game = game.known(game.parameters.values(unknown))
    return _goes_on(game, weights, recording.states[-1], horizon)


def _goes_on(game: Game, weights: np.ndarray, last: np.ndarray, horizon: int) -> np.ndarray | None:
    """The equilibrium over T = ``horizon`` states from a state (N, n); None if none is found."""
    try:
        found = solve_olne(replace(game, horizon=horizon), weights, last, max_rounds=_ROUNDS)
    except ValueError:  # the state breaks a constraint
        return None
    return found.states if found.certificate.passed else None


@lru_cache(maxsize=16)
def _held_out_roots(draw: Draw, theta: bytes, root_iterations: int) -> tuple[Root, ...] | None:
    """Roots from the held-out states at theta; None as in ``held_out``."""
    try:
        recordings = held_out_recordings(draw)
    except NoEquilibriumError:  # nothing near this draw to predict
        return None
    known = _prediction(draw, theta, root_iterations).root
    if known is None:
        return None
    shaped = np.frombuffer(theta).reshape(recordings[0].scenario.theta.shape)
    roots = follow_start(recordings, shaped, known)
    return tuple(roots) if len(roots) == len(recordings) else None


@lru_cache(maxsize=128)
def _unit_limit(draw: Draw, model: SensorModel) -> float | None:
    return _limit(true_recording(draw), sensitivities_of(draw, model))


def _limit(recording: Recording, sensitivities: Sequence[np.ndarray]) -> float | None:
    told = recording.scenario.told
    covariance = of_weights(told, joint_weight_covariance(told, sensitivities))
    if covariance is None:
        return None
    return cosine_error_limit(covariance, recording.scenario.weights)


@lru_cache(maxsize=8)
def _prediction(draw: Draw, theta: bytes, root_iterations: int) -> Prediction:
    recording = true_recording(draw)
    scenario = recording.scenario
    shaped = np.frombuffer(theta).reshape(scenario.theta.shape)
    return predict(
        scenario.told, shaped, recording.root, scenario.theta, max_iterations=root_iterations
    )

"""Estimators that find a number of the constraints beside the weights: the size of vehicles."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.merging import DIAMETER, Merging, asking_for_the_diameter, scenario
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.ignorant import Ignorant
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Estimate, Estimator, Observation, Problem
from olne_bench.estimators.ukf import Ukf
from olne_bench.games.model.constraints import Distance
from olne_bench.games.model.costs import ControlEffort, FinalGoal, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.equilibrium import Equilibrium
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.model.unknowns import Unknown
from olne_bench.games.solve.information import identifiability, observation_sensitivity
from olne_bench.games.solve.olne import solve_olne

DRAWN = get_scenario("merging", 6, unknown_radius=True, weights="moderate")
DRIVING = np.array([[0.7, -0.05, 0, 0.6], [-1, -0.02, 0, 0.63], [-2.4, -0.08, 0.05, 0.5]])


@pytest.fixture(scope="module")
def touching() -> Equilibrium:
    """The motion of a draw in which contact is active."""
    truth = solve_olne(DRAWN.game, DRAWN.weights, DRAWN.initial_state)
    assert truth.active.any()
    return truth


def _estimated(
    estimator: Estimator, drawn: Scenario, states: np.ndarray, *, view: str = "full", sigma: float
) -> Estimate:
    y = observe(VIEWS[view], drawn.game.dynamics, states)
    y = y + sigma * np.random.default_rng(1).standard_normal(y.shape)
    problem = Problem(drawn.told, VIEWS[view], sigma)
    return estimator.estimate(problem, Observation(y), rng=np.random.default_rng(0), budget=120.0)


def _diameter(estimate: Estimate) -> float:
    assert estimate.parameters is not None
    assert np.isnan(estimate.parameters[1:]).all()  # listed with the first player
    return float(estimate.parameters[0, 0])


def test_each_seed_draws_a_diameter_that_all_pairs_share() -> None:
    other = get_scenario("merging", 2, unknown_radius=True)
    for one in (DRAWN, other):
        (known,) = {c.distance for c in one.game.constraints if isinstance(c, Distance)}
        assert one.parameters is not None
        assert one.parameters[0, 0] == known
        assert [len(own) for own in one.told.parameters.unknowns] == [1, 0, 0]
    assert DRAWN.parameters is not None
    assert (DRAWN.parameters != other.parameters).any()
    assert get_scenario("merging", 2).parameters is None
    with pytest.raises(ValueError, match="unknown_radius must be true or false, got 1"):
        Merging(unknown_radius=1)  # type: ignore[arg-type]


@pytest.mark.parametrize("view", ["full", "partial"])
@pytest.mark.parametrize("estimator", [KktConstrained(), Bilevel()])
def test_exact_motion_gives_weights_and_diameter(estimator, view, touching) -> None:
    found = _estimated(estimator, DRAWN, touching.states, view=view, sigma=0.0)
    assert found.converged
    assert abs(_diameter(found) - DRAWN.parameters[0, 0]) < 1e-5
    assert np.abs(found.weights - DRAWN.weights).max() < 1e-6


def test_without_noise_the_barrier_does_not_pull_weights() -> None:
    for seed in (4, 11):  # 3e-5 and 1e-4 with the tolerance of noisy problems
        drawn = get_scenario("merging", seed, weights="moderate")
        truth = solve_olne(drawn.game, drawn.weights, drawn.initial_state)
        found = _estimated(KktConstrained(), drawn, truth.states, view="partial", sigma=0.0)
        assert np.abs(found.weights - drawn.weights).max() < 1e-6


@pytest.mark.parametrize("estimator", [KktConstrained(), Bilevel()])
def test_contact_tells_the_diameter_within_two_percent(estimator, touching) -> None:
    found = _estimated(estimator, DRAWN, touching.states, sigma=0.005)
    error = _diameter(found) - DRAWN.parameters[0, 0]
    assert abs(error) < 0.02 * DRAWN.parameters[0, 0]
    deviation = found.parameter_deviations[0, 0]
    assert 1e-4 < deviation < 0.01 * DRAWN.parameters[0, 0]
    assert abs(error) < 4 * deviation
    assert found.message == ""


def test_filters_know_more_than_the_prior() -> None:
    apart = Unknown("distance", "m", 0.4, 1.2, 0.7, 0.15)
    likes = (
        StateDeviation("speed"),
        ControlEffort("acceleration", 10.0),
        ControlEffort("yaw_rate"),
    )
    goals = ((1.0, 0.0), (0.0, 1.0))
    players = tuple(Player(likes, (FinalGoal(goal, scale=10.0),)) for goal in goals)
    asked = Game(players, UNICYCLE, 12, 0.4, (Distance((0, 1), apart),))  # type: ignore[arg-type]
    start = np.array([[-1.0, 0.0, 0.1, 0.3], [0.1, -1.0, 1.5, 0.25]])
    drawn = Scenario(
        "crossing",
        asked.known(np.array([[0.8], [np.nan]])),
        np.array([[0.2, 0.3, 0.5], [0.45, 0.3, 0.25]]),
        start,
        asked=asked,
        parameters=np.array([[0.8], [np.nan]]),
    )
    truth = solve_olne(drawn.game, drawn.weights, start)
    found = _estimated(Ukf(), drawn, truth.states, sigma=0.01)
    assert abs(_diameter(found) - 0.8) < 0.05
    assert found.parameter_deviations[0, 0] < 0.2 * apart.deviation


def test_who_ignores_constraints_has_the_prior(touching) -> None:
    found = _estimated(Ignorant(), DRAWN, touching.states, sigma=0.005)
    assert _diameter(found) == DIAMETER.mean
    assert found.parameter_deviations[0, 0] == DIAMETER.deviation


@pytest.mark.parametrize("sigma", [0.0, 0.005])
def test_what_nothing_seen_depends_on_is_said(sigma) -> None:
    drawn = asking_for_the_diameter(scenario(DRIVING, None, 0.15), 0.15)
    truth = solve_olne(drawn.game, drawn.weights, drawn.initial_state)
    assert not truth.active.any()
    found = _estimated(KktConstrained(), drawn, truth.states, sigma=sigma)
    assert found.converged
    assert found.message == (
        "nothing that was seen depends on the diameter of constraint 'distance' of players 0 and 1"
    )
    if sigma:
        assert found.covariance is not None
        assert found.parameter_deviations[0, 0] == pytest.approx(DIAMETER.deviation)


def test_identifiability_of_weights_is_that_of_the_asked_game(touching) -> None:
    truth = touching
    known, asked = (
        identifiability(
            game,
            [
                observation_sensitivity(
                    game, VIEWS["full"], truth.states, truth.controls, truth.costates, theta
                )
            ],
            sigma=0.005,
        )
        for game, theta in ((DRAWN.game, DRAWN.weights), (DRAWN.told, DRAWN.theta))
    )
    assert (asked.bound >= known.bound * (1 - 1e-6)).all()
    assert (asked.bound > 1.001 * known.bound).any()
    assert np.median(asked.bound / known.bound) < 1.5

"""Policies that were cloned from players of the simulator."""

import numpy as np
import pytest

from olne_bench.bench.judge.cloned_policy import Policy, driven, policy_of
from olne_bench.bench.judge.predictions import drive_as_cloned, drive_on
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.protocol import Problem
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.olne import solve_olne

NAMES = ("two_player", "highway_overtaking")
FIRST = 900_000  # of seeds; policies are trained on draws of another stream


@pytest.fixture(scope="module", params=NAMES)
def motions(request) -> tuple[Game, list[np.ndarray]]:
    """Equilibria at weights that are uniform on the simplex."""
    found = []
    for seed in range(FIRST, FIRST + 12):
        scenario = get_scenario(request.param, seed, weights="dirichlet")
        game, start = scenario.game, scenario.initial_state
        found.append(solve_olne(game, scenario.weights, start).states)
    return game, found


def test_it_predicts_better_than_straight_on(motions) -> None:
    game, states = motions
    problem, seen = Problem(game, VIEWS["full"], 0.01), game.horizon // 2
    errors = {drive_on: [], drive_as_cloned: []}
    for truth in states:
        for drive, found in errors.items():
            ahead = drive(problem, truth[:seen])
            assert ahead is not None and ahead.shape == truth.shape
            found.append(np.linalg.norm((ahead - truth)[seen:, :, :2], axis=-1).mean())
    assert np.median(errors[drive_as_cloned]) < 0.8 * np.median(errors[drive_on])


@pytest.mark.parametrize("seen", [1, 2, 25])
def test_every_number_of_samples_has_a_prediction(seen) -> None:
    scenario = get_scenario("two_player", FIRST, weights="dirichlet")
    states = solve_olne(scenario.game, scenario.weights, scenario.initial_state).states
    found = drive_as_cloned(Problem(scenario.game, VIEWS["full"], 0.01), states[:seen])
    assert found is not None and found.shape == states.shape and np.isfinite(found).all()
    if seen == len(states):
        np.testing.assert_allclose(found[:-1], states[:-1], atol=1e-6)


def test_controls_are_those_of_the_network_in_their_units() -> None:
    game = get_scenario("two_player").game
    offset = np.array([1.0, -2.0, 0.5, 20.0])  # the last one is out of range
    policy = Policy(
        layers=((np.zeros((4, 13)), offset),),
        centre=np.zeros((2, 4)),
        spread=np.ones((2, 4)),
        control_spread=np.array([[0.1, 0.2], [0.3, 0.5]]),
        game="",
    )
    states = np.array([[0.0, 0.0, 0.0, 1.0], [5.0, 0.0, 0.0, 1.0]])
    found = policy.controls(states, np.zeros((2, 2)), 0.5)
    np.testing.assert_allclose(found, [[0.1, -0.4], [0.15, 6.0]])
    ahead = driven(policy, game, states, np.zeros((2, 2)), 2)
    assert ahead.shape == (3, 2, 4)
    np.testing.assert_allclose(ahead[:, :, 3] - 1.0, np.outer([0, 1, 2], [-0.1, 1.5]), atol=1e-9)
    np.testing.assert_allclose(ahead[2, :, 2], [0.05, 0.075], atol=1e-9)


def test_other_games_have_no_policy() -> None:
    game = get_scenario("random", 0).game
    assert policy_of(game) is None
    problem = Problem(game, VIEWS["full"], 0.01)
    assert drive_as_cloned(problem, np.zeros((3, *game.state_shape[1:]))) is None

import re
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from olne_bench.games.model.costs import ControlEffort, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player, player_cost, trajectory_symbols

PLAYER = Player((Proximity(), StateDeviation("speed"), ControlEffort("yaw_rate")))
GAME = Game((PLAYER, PLAYER), UNICYCLE, horizon=5, dt=0.1)


def test_shapes_and_layout() -> None:
    assert (GAME.num_players, GAME.num_weights) == (2, 3)
    assert (GAME.state_shape, GAME.control_shape) == ((5, 2, 4), (4, 2, 2))
    assert GAME.weight_names == ("proximity", "speed", "yaw_rate")


def test_equal_games_share_their_solvers() -> None:
    twin = Game((PLAYER, PLAYER), UNICYCLE, horizon=5, dt=0.1)
    assert twin == GAME and hash(twin) == hash(GAME)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"players": ()}, "at least one player, got none"),
        ({"horizon": 1}, "at least 2, got 1"),
        ({"horizon": 0}, "at least 2, got 0"),
        ({"horizon": 2.5}, "an integer of at least 2, got 2.5"),
        ({"horizon": "3"}, "an integer of at least 2, got '3'"),
        ({"dt": 0.0}, "dt must be a positive number of seconds, got 0.0"),
        ({"dt": -1.0}, "got -1.0"),
        ({"dt": float("nan")}, "got nan"),
        ({"dt": float("inf")}, "got inf"),
        ({"dt": "x"}, "got 'x'"),
        ({"players": (Player(()),)}, "at least one preference"),
        ({"players": (Player((Proximity(), Proximity())),)}, "different names"),
        (
            {"players": (PLAYER, Player((StateDeviation("speed"), Proximity())))},
            r"player 1 has the preferences \('speed', 'proximity'\), player 0 has",
        ),
    ],
)
def test_bad_games_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(GAME, **change)


def test_weights_are_scaled_to_row_sums_of_one() -> None:
    given = np.array([[1, 1, 2], [0, 0, 5]])
    np.testing.assert_array_equal(GAME.check_weights(given), [[0.25, 0.25, 0.5], [0, 0, 1]])
    np.testing.assert_array_equal(given, [[1, 1, 2], [0, 0, 5]])


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.ones((3, 2)), "weights have the shape (3, 2), expected (2, 3)"),
        (np.ones(6), "weights have the shape (6,), expected (2, 3)"),
        (np.array([[1, 1, -1], [1, 1, 1]]), "finite and non-negative, got [[1.0, 1.0, -1.0]"),
        (np.array([[1, 1, np.nan], [1, 1, 1]]), "finite and non-negative"),
        (np.array([[1, 1, np.inf], [1, 1, 1]]), "finite and non-negative"),
        (np.array([[0, 0, 0], [1, 1, 1]]), "each player needs a positive weight"),
    ],
)
def test_bad_weights_are_refused(weights: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        GAME.check_weights(weights)


@pytest.mark.parametrize(
    ("initial_state", "message"),
    [
        (np.zeros((4, 2)), "initial_state has the shape (4, 2), expected (2, 4)"),
        (np.full((2, 4), np.nan), "initial_state must be finite"),
        (np.full((2, 4), np.inf), "initial_state must be finite"),
    ],
)
def test_bad_initial_states_are_refused(initial_state: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        GAME.check_initial_state(initial_state)


def test_good_initial_states_are_taken_as_they_are() -> None:
    given = [[1, 2, 3, 4], [5, 6, 7, 8]]
    np.testing.assert_array_equal(GAME.check_initial_state(given), np.array(given, dtype=float))


@pytest.mark.parametrize("shape", [(3, 2, 4), (2, 3, 1), (1, 1, 2), (0, 2, 4)])
def test_symbols_are_in_the_order_of_arrays(shape: tuple[int, int, int]) -> None:
    flat, blocks = trajectory_symbols("x", shape)
    assert [len(row) for row in blocks] == [shape[1]] * shape[0]
    values = np.random.default_rng(0).standard_normal(shape)
    parts = [block for row in blocks for block in row]
    found = ca.Function("blocks", [flat], parts)(values.ravel()) if parts else ()
    found = (found,) if isinstance(found, ca.DM) else found
    for one, wanted in zip(found, values.reshape(-1, shape[2]), strict=True):
        np.testing.assert_array_equal(np.array(one).ravel(), wanted)


def test_a_players_cost_is_summed_over_the_whole_trajectory() -> None:
    game = Game((PLAYER, PLAYER), UNICYCLE, horizon=3, dt=0.1)
    x, states = trajectory_symbols("x", game.state_shape)
    u, controls = trajectory_symbols("u", game.control_shape)
    theta = ca.SX.sym("theta", 3)
    rng = np.random.default_rng(1)
    given = rng.standard_normal(game.state_shape), rng.standard_normal(game.control_shape)
    weights = np.array([0.2, 0.3, 0.5])
    for player in (0, 1):
        own = [row[player] for row in controls]
        cost = player_cost(game, player, states, own, theta)
        found = ca.Function("J", [x, u, theta], [cost])(given[0].ravel(), given[1].ravel(), weights)
        gaps = np.sum((given[0][:, 0, :2] - given[0][:, 1, :2]) ** 2, axis=1)
        near = -0.1 * np.log(gaps + 0.1).sum()
        fast = (given[0][:, player, 3] ** 2).sum()
        turned = ((0.1 * given[1][:, player, 0]) ** 2).sum()
        assert float(found) == pytest.approx(weights @ [near, fast, turned], rel=1e-12)

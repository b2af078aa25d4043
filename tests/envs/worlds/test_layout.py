"""Layouts split observations; spaces check actions."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.worlds.layout import (
    ObservationLayout,
    Spaces,
    SpaceSize,
    player_index,
    player_name,
)

LAYOUT = ObservationLayout(("px", "py"), 3)


def test_names_and_indices_are_inverses() -> None:
    assert [player_index(player_name(i)) for i in (0, 7, 12)] == [0, 7, 12]


def test_a_vector_has_a_block_per_player_and_the_time() -> None:
    assert (LAYOUT.state_size, LAYOUT.size) == (2, 7)


def test_blocks_come_back_in_the_order_of_players() -> None:
    assert LAYOUT.order("player_1") == [1, 0, 2]
    seen = np.array([10, 11, 0, 1, 20, 21, 0.5], dtype=np.float32)
    np.testing.assert_array_equal(LAYOUT.blocks(seen), [[10, 11], [0, 1], [20, 21]])
    ordered = LAYOUT.by_index(seen, "player_1")
    np.testing.assert_array_equal(ordered, [[0, 1], [10, 11], [20, 21]])
    assert ordered.dtype == np.float32


SCENARIO = get_scenario("highway_overtaking")
SPACES = Spaces(SpaceSize.of(SCENARIO))
PLAYERS = list(SPACES.actions)
LIMITS = np.array(SCENARIO.limits.controls)


def actions() -> dict[str, np.ndarray]:
    return {player: 0.1 * (i + 1) * LIMITS for i, player in enumerate(PLAYERS)}


def test_bounds_are_those_of_the_scenario() -> None:
    game = SCENARIO.game
    high = [*np.tile(SCENARIO.limits.states, game.num_players), (game.horizon - 1) * game.dt]
    np.testing.assert_array_equal(SPACES.state.high, high)
    np.testing.assert_array_equal(SPACES.state.low, [*-np.array(high[:-1]), 0.0])
    for player in PLAYERS:
        assert SPACES.observations[player] == SPACES.state
        np.testing.assert_array_equal(SPACES.actions[player].high, LIMITS)
        np.testing.assert_array_equal(SPACES.actions[player].low, -LIMITS)


def test_every_player_sees_itself_first_and_the_time_last() -> None:
    size = SPACES.state.shape[0]
    for i, player in enumerate(PLAYERS):
        order = SPACES.observation_order[player]
        assert sorted(order) == list(range(size))
        assert list(order[:4]) == list(range(4 * i, 4 * i + 4))
        assert order[-1] == size - 1


def test_actions_become_controls_and_who_left_has_zeros() -> None:
    np.testing.assert_allclose(SPACES.controls(actions(), PLAYERS), np.array([*actions().values()]))
    some = {player: action for player, action in actions().items() if player != PLAYERS[1]}
    controls = SPACES.controls(some, list(some))
    np.testing.assert_array_equal(controls[1], 0)
    np.testing.assert_allclose(controls[2], actions()[PLAYERS[2]])


def test_limits_may_be_reached_from_both_sides() -> None:
    for sign in (-1, 1):
        full = dict.fromkeys(PLAYERS, sign * LIMITS)
        np.testing.assert_array_equal(SPACES.controls(full, PLAYERS), np.array([*full.values()]))


@pytest.mark.parametrize("value", [1.01, -1.01, np.nan])
def test_the_first_control_out_of_its_limits_is_named(value: float) -> None:
    wrong = actions()
    wrong["player_2"] = LIMITS * (0.5, value)
    with pytest.raises(ValueError, match=r"acceleration of player_2 is .*must be within \[-"):
        SPACES.controls(wrong, PLAYERS)


def test_players_who_must_not_or_do_not_act_are_named() -> None:
    wrong = actions()
    wrong["car"] = wrong.pop("player_1")
    with pytest.raises(ValueError, match="no action for player_1; unknown player car; players are"):
        SPACES.controls(wrong, PLAYERS)
    with pytest.raises(ValueError, match=r"^unknown player player_4; players are"):
        SPACES.controls(actions(), PLAYERS[:4])


def test_actions_of_another_shape_or_kind_are_refused() -> None:
    with pytest.raises(ValueError, match=r"player_0 has the shape \(3,\), expected 2 numbers"):
        SPACES.controls(actions() | {"player_0": np.zeros(3)}, PLAYERS)
    with pytest.raises(ValueError, match="player_0 is 'left', expected 2 numbers"):
        SPACES.controls(actions() | {"player_0": "left"}, PLAYERS)


def test_an_unknown_player_has_no_space() -> None:
    assert SPACES.of_player("player_3", SPACES.actions) is SPACES.actions["player_3"]
    with pytest.raises(ValueError, match="unknown player 'car'; players are: player_0, player_1"):
        SPACES.of_player("car", SPACES.actions)

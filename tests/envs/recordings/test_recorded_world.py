"""A world that plays a recording."""

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from olne_bench.envs.recordings.recording import RecordedWorld


@pytest.fixture
def recording(recorded):
    return recorded("two_player")


def test_it_is_a_world_like_any_other(recording) -> None:
    parallel_api_test(RecordedWorld(recording), num_cycles=60)


def test_the_recording_is_shown_with_its_extra_state_and_the_time(recording) -> None:
    world = RecordedWorld(recording)
    game = recording.scenario.game
    expected = [*recording.states, recording.extra_state]
    for _ in range(2):  # repeatedly
        shown, infos = world.reset(seed=3)
        assert infos == {"player_0": {}}
        for step, states in enumerate(expected):
            assert world.agents == ["player_0"] * (step < game.horizon)
            np.testing.assert_array_equal(shown["player_0"], [*states.ravel(), step * game.dt])
            np.testing.assert_array_equal(world.state(), shown["player_0"])
            assert world.observation_space("player_0").contains(shown["player_0"])
            if world.agents:
                shown, rewards, over, cut, _ = world.step({})
                assert rewards == {"player_0": 0.0}
                assert over == {"player_0": step == game.horizon - 1}
                assert cut == {"player_0": False}
        assert world.step({}) == ({}, {}, {}, {}, {})
    with pytest.raises(ValueError, match="read-only"):
        world.state()[0] = 1.0


def test_blocks_are_players_in_the_order_of_their_indices(recording) -> None:
    world = RecordedWorld(recording)
    shown, _ = world.reset()
    layout = world.observation_layout
    assert layout.num_players == 2
    np.testing.assert_array_equal(
        layout.by_index(shown["player_0"], "player_0"), recording.states[0]
    )


def test_a_world_that_was_never_reset_stands_at_the_first_step(recording) -> None:
    world = RecordedWorld(recording)
    np.testing.assert_array_equal(world.state(), [*recording.states[0].ravel(), 0.0])
    assert world.agents == []
    idle = world.action_space("player_0")
    assert idle.shape == (2,)
    assert idle.is_bounded() and idle.contains(np.zeros(2))

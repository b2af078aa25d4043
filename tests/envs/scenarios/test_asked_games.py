"""Scenarios that leave more than weights open."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.unknowns import with_unknowns
from olne_bench.plugins import PluginError


def test_goals_are_drawn_around_the_published_ones() -> None:
    drawn = [get_scenario("unknown_goals", seed) for seed in range(200)]
    published = get_scenario("two_player").game
    assert all(one.told == drawn[0].told for one in drawn)  # what is told does not depend on it
    offsets = np.array([one.parameters - one.told.parameters.means for one in drawn])
    np.testing.assert_allclose(offsets.mean(axis=0), 0, atol=0.06)
    np.testing.assert_allclose(offsets.std(axis=0), 0.2, atol=0.04)
    assert drawn[0].told.at_means == published
    assert drawn[0].game.players[0].task[0].goal == tuple(drawn[0].parameters[0])


@pytest.mark.parametrize("name", ["intersection", "two_way"])
def test_target_speeds_are_those_of_the_draw(name: str) -> None:
    open_, closed = (get_scenario(name, 0, unknown_speeds=on) for on in (True, False))
    assert open_.game == closed.game
    assert closed.told is closed.game
    targets = [[player.preferences[1].target] for player in closed.game.players]
    assert open_.parameters.tolist() == targets
    names = [[one.name for one in own] for own in open_.told.parameters.unknowns]
    assert names == [["target speed"]] * len(targets)
    np.testing.assert_allclose(open_.theta[:, :4], closed.weights)
    assert np.abs(open_.theta[:, 4]).max() < np.sqrt(3) + 1e-9  # within the road's speeds


def test_what_is_told_tells_no_truth() -> None:
    """Whoever reads all numbers of the told game does not find those that are to be found."""
    one = get_scenario("unknown_goals", 3)
    text = repr(one.told)
    assert not any(repr(float(value)) in text for value in one.parameters.ravel())


def test_a_truth_out_of_its_range_is_refused() -> None:
    one = get_scenario("unknown_goals", 0)
    with pytest.raises(ValueError, match=r"player 0: goal x must be from 0.4 to 1.6 m, got 5.0"):
        replace(one, parameters=np.where([[True, False], [False, False]], 5.0, one.parameters))
    with pytest.raises(ValueError, match="do not make asked the same as game"):
        replace(one, parameters=one.parameters + 0.01)
    with pytest.raises(ValueError, match="needs both asked and parameters"):
        replace(one, parameters=None)
    with pytest.raises(PluginError, match="unknown_speeds must be true or false, got 1"):
        get_scenario("highway", 0, unknown_speeds=1)


def test_a_truth_where_its_prior_has_no_mass_is_refused() -> None:
    one = get_scenario("unknown_goals", 0)
    mean, value = one.told.parameters.means[0, 0], one.parameters[0, 0]
    assert abs(value - mean) > 1e-4

    def with_deviation(deviation: float):
        def change(unknown):
            return replace(unknown, deviation=deviation) if unknown.name == "goal x" else unknown

        first, second = one.told.players
        players = with_unknowns(first, change), second
        return replace(one, asked=replace(one.told, players=players))

    assert with_deviation(abs(value - mean) / 7.9).parameters is not None
    with pytest.raises(ValueError, match=r"the prior of 'goal x' of player 0 .* no mass: .* 8 dev"):
        with_deviation(abs(value - mean) / 8.1)

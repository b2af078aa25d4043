"""Cars in one lane."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.solve.olne import solve_olne


def test_draws_are_certified_and_differ() -> None:
    found = [get_scenario("following", seed, num_players=3) for seed in range(4)]
    for scenario in found:
        plan = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
        assert plan.certificate.passed
        assert (np.diff(scenario.initial_state[:, 0]) <= -12).all()
    assert len({scenario.initial_state.tobytes() for scenario in found}) == 4


def test_who_follows_minds_its_leader_and_nobody_behind() -> None:
    scenario = get_scenario("following", 1, num_players=3)
    plan = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    start = scenario.initial_state.copy()
    start[1, 3] += 3.0
    changed = solve_olne(scenario.game, scenario.weights, start)
    off = np.abs(changed.states - plan.states)[..., 3].max(axis=0)
    assert off[0] < 1e-8
    assert off[2] > 0.1


@pytest.mark.parametrize("count", [0, 21, 2.5])
def test_the_number_of_players_is_checked(count: float) -> None:
    with pytest.raises(ValueError, match="num_players"):
        get_scenario("following", 0, num_players=count)

"""Stage costs add up to the cost whose gradient the equilibrium conditions take."""

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.compiled.buffered import BufferedFunction
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.stage_costs import stage_costs
from olne_bench.games.solve.kkt import kkt_system


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking"])
def test_stages_add_up_to_the_whole(name):
    scenario = get_scenario(name)
    game, weights = scenario.game, scenario.weights
    controls = 0.1 * np.random.default_rng(0).standard_normal(game.control_shape)
    states = rollout(game.dynamics, scenario.initial_state, controls, game.dt)
    stages = stage_costs(game)
    running, final = BufferedFunction(stages.running), BufferedFunction(stages.final)
    total = final(states[-1], weights)[0].copy()
    for row, control in zip(states[:-1], controls, strict=True):
        total += running(row, control, weights)[0]
    whole = kkt_system(game).cost_function(states.ravel(), controls.ravel(), weights.ravel())
    assert np.allclose(total, np.array(whole).ravel(), rtol=1e-13, atol=1e-13)

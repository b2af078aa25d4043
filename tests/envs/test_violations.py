"""Worlds say by how much constraints are broken, and infeasible draws are never a truth."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs import olne_v0
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.intersection import Intersection
from olne_bench.envs.scenarios.merging import Merging
from olne_bench.envs.scenarios.scenario import NoEquilibriumError
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.games.model.constraints import ControlBound, Distance, StateBound

PAIR = ("distance", "player_0", "player_1")


def test_the_equilibrium_breaks_nothing_and_coasting_does() -> None:
    world = olne_v0.parallel_env("merging")
    for coasting in (False, True):
        _, infos = world.reset(seed=0)
        largest = 0.0
        while world.agents:
            actions = {p: infos[p]["olne_action"] for p in world.agents}
            if coasting:
                actions = {p: np.zeros_like(action) for p, action in actions.items()}
            *_, infos = world.step(actions)
            found = infos["player_0"]["violations"]
            assert set(found) == {PAIR, ("distance", "player_0", "player_2")}
            assert found[PAIR] == infos["player_1"]["violations"][PAIR]
            largest = max(largest, *found.values())
        assert (largest > 0.01) if coasting else (largest <= 1e-8)


def test_controls_are_judged_with_the_step_that_they_lead_to() -> None:
    known = get_scenario("two_player")
    game = replace(known.game, constraints=(ControlBound((1,), "acceleration", upper=0.5),))
    world = olne_v0.parallel_env(replace(known, game=game), reveal_truth=False)
    _, infos = world.reset()
    key = ("acceleration", "player_1")
    assert infos["player_1"] == {"violations": {key: 0.0}}
    assert infos["player_0"] == {"violations": {}}
    actions = {p: np.array([0.0, 0.75]) for p in world.agents}
    *_, infos = world.step(actions)
    assert infos["player_1"]["violations"][key] == pytest.approx(0.25)


def test_worlds_without_constraints_say_nothing() -> None:
    _, infos = olne_v0.parallel_env("two_player").reset()
    assert "violations" not in infos["player_0"]


def test_a_start_in_collision_has_no_equilibrium() -> None:
    known = Merging().draw()
    start = known.initial_state.copy()
    start[1, :2] = start[0, :2]
    message = "no equilibrium of 'merging': constraint 'distance' of players 0 and 1 is broken"
    with pytest.raises(NoEquilibriumError, match=message):
        certified_equilibrium(replace(known, initial_state=start))


def test_what_no_motion_keeps_is_named() -> None:
    known = get_scenario("merging")
    fast = StateBound((2,), "speed", upper=0.5, first_step=1)  # it starts at 0.63
    game = replace(known.game, constraints=(*known.game.constraints[:1], fast))
    with pytest.raises(NoEquilibriumError, match="constraint 'speed' of player 2 is broken by 0"):
        certified_equilibrium(
            replace(
                known,
                game=replace(
                    game,
                    constraints=(*game.constraints, ControlBound((2,), "acceleration", lower=-0.1)),
                ),
            )
        )


def test_roads_take_a_hard_distance() -> None:
    rng = np.random.default_rng(0)
    constraints = Intersection(num_players=3, distance=6.0).constrained(rng, 3).game.constraints
    assert constraints == tuple(Distance(pair, 6.0) for pair in ((0, 1), (0, 2), (1, 2)))
    assert not Intersection().constrained(rng, 3).game.constraints
    with pytest.raises(ValueError, match="distance must be at least 0 m, got -1"):
        Intersection(distance=-1)


def test_drawn_weights_differ_by_seed() -> None:
    assert np.ptp(Merging().draw(2).weights) == 0
    one, other = (Merging(weights="moderate").draw(seed).weights for seed in (2, 4))
    assert np.abs(one - other).max() > 0.05

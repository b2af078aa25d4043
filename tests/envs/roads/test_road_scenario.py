"""Drivers on roads; draws that HighwayEnv does not play are refused."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from olne_bench.envs.roads import road_scenario as driving
from olne_bench.envs.roads.highway_roads import DT, MAX_ACCELERATION, MAX_STEERING
from olne_bench.envs.roads.road_scenario import (
    FAST,
    MAX_DRAWS,
    TOWN,
    Driver,
    draw_playable,
    draw_weights,
    driving_scenario,
    rejection,
)
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import NoEquilibriumError
from olne_bench.games.model.costs import Stage
from olne_bench.games.model.lanes import StraightLane

LANE = StraightLane((0.0, 4.0), (1.0, 0.0), 1000.0)
DRIVERS = [Driver((50.0 * k, 4.0, 0.0, 20.0), (LANE,), 25.0) for k in range(2)]


@pytest.mark.parametrize("manner", [FAST, TOWN])
def test_a_unit_of_each_preference_costs_one(manner) -> None:
    scenario = driving_scenario("highway", DRIVERS, manner, np.full((2, 4), 0.25))
    game = scenario.game
    assert scenario.noise_scale == (1.0, 1.0, 0.1, 1.0)
    assert game.weight_names == ("proximity", "speed", "acceleration", "steering")
    np.testing.assert_array_equal(scenario.initial_state, [d.state for d in DRIVERS])
    proximity, speed, acceleration, steering = game.players[0].preferences

    def cost(feature, own, control=(0.0, 0.0), other=(1e3, 4.0, 0.0, 20.0)) -> float:
        states = tuple(ca.DM(np.array(x, dtype=float)) for x in (own, other))
        return float(feature.running_cost(Stage(0, states, ca.DM(control), game.dynamics, DT)))

    at_ease = (100.0, 4.0, 0.0, 25.0)
    assert cost(speed, at_ease) == 0
    assert cost(speed, (100.0, 4.0, 0.0, 25.0 - manner.speed)) == pytest.approx(1)
    assert cost(acceleration, at_ease, (0.0, manner.acceleration)) == pytest.approx(1)
    assert cost(steering, at_ease, (manner.steering, 0.0)) == pytest.approx(1)
    ahead = cost(proximity, at_ease, other=(100.0 + manner.length, 4.0, 0.0, 20.0))
    beside = cost(proximity, at_ease, other=(100.0, 4.0 + manner.width, 0.0, 20.0))
    assert ahead == pytest.approx(beside)
    assert ahead == pytest.approx(-manner.proximity * np.log(1.1))
    (keeping,) = game.players[0].task
    turned = (100.0, 4.0, manner.heading, 25.0)
    assert cost(keeping, at_ease) == pytest.approx(0, abs=1e-9)
    assert cost(keeping, turned) == pytest.approx(1, rel=0.02)
    assert cost(keeping, (100.0, 4.0 + manner.lane, 0.0, 25.0)) == pytest.approx(1, rel=0.05)


def test_the_first_playable_draw_is_taken_and_draws_are_seeded(monkeypatch) -> None:
    drawn = []

    def draw(rng):
        drawn.append(rng.uniform())
        return len(drawn)

    monkeypatch.setattr(driving, "rejection", lambda n: None if n == 3 else "collision")
    assert draw_playable("highway", draw, 5, 2) == 3
    expected = [np.random.default_rng([5, 2, k]).uniform() for k in range(3)]
    assert drawn == expected


def test_too_many_rejections_are_told(monkeypatch) -> None:
    tried = []
    monkeypatch.setattr(driving, "rejection", lambda _: "collision")
    with pytest.raises(NoEquilibriumError, match="no playable draw of 'highway' in 20 from seed 5"):
        draw_playable("highway", lambda rng: tried.append(rng), 5, 2)
    assert len(tried) == MAX_DRAWS == 20


def test_weights_are_drawn_from_their_range() -> None:
    weights = draw_weights(np.random.default_rng(0), 500)
    assert weights.shape == (500, 4)
    assert 0.2 <= weights.min() < 0.21
    assert 0.99 < weights.max() <= 1.0


DRAW = get_scenario("highway", 0, num_players=3)


@pytest.fixture
def planned(monkeypatch):
    """Set the equilibrium that a test needs."""

    def plan(change):
        from olne_bench.envs.roads import road_scenario

        original = road_scenario.certified_equilibrium

        def changed(scenario):
            return change(original(scenario))

        monkeypatch.setattr(road_scenario, "certified_equilibrium", changed)

    return plan


def test_a_draw_of_a_family_is_played_exactly() -> None:
    assert rejection(DRAW) is None


def test_a_draw_without_an_equilibrium_is_rejected(planned) -> None:
    def none(_plan):
        raise NoEquilibriumError

    planned(none)
    assert rejection(DRAW) == "no equilibrium"


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("column", [0, 1])
def test_a_plan_beyond_what_cars_can_do_is_rejected(planned, sign, column) -> None:
    def harder(plan):
        controls = plan.controls.copy()
        controls[3, 1, column] = sign * 1.01 * (MAX_STEERING, MAX_ACCELERATION)[column]
        return replace(plan, controls=controls)

    planned(harder)
    assert rejection(DRAW) == "out of limits"


def test_a_plan_faster_than_the_simulator_is_rejected(planned) -> None:
    def faster(plan):
        states = plan.states.copy()
        states[-1, 0, 3] = -40.5
        return replace(plan, states=states)

    planned(faster)
    assert rejection(DRAW) == "out of limits"


def test_a_plan_that_the_simulator_does_not_follow_is_rejected(planned) -> None:
    def off(plan):
        states = plan.states.copy()
        states[-1, 0, 0] += 1e-6
        return replace(plan, states=states)

    planned(off)
    assert rejection(DRAW) == "collision"


def test_cars_too_close_to_each_other_are_rejected() -> None:
    """Two cars side by side, with a gap of less than two margins."""
    lane = DRAW.game.players[0].task[0].route
    y = DRAW.initial_state[0, 1]
    drivers = [Driver((100.0, y + dy, 0.0, 20.0), lane, 20.0) for dy in (0.0, 2.3)]
    scenario = driving_scenario("highway", drivers, FAST, np.full((2, 4), 0.25))
    assert rejection(scenario) in ("collision", "no equilibrium")

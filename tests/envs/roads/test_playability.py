"""Which draws HighwayEnv plays exactly."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.roads.highway_roads import MAX_ACCELERATION, MAX_STEERING
from olne_bench.envs.roads.road_scenario import FAST, Driver, driving_scenario, rejection
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import NoEquilibriumError

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

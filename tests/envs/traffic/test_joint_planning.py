"""The next plan of each vehicle, from the solution of its game."""

import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork

from olne_bench.envs.traffic import NashVehicle, Temperament, joint_planning, traffic_report
from olne_bench.envs.traffic.joint_planning import NUM_OTHERS, TrafficReport, plan_together
from olne_bench.envs.traffic.planning_vehicle import PLAN_STEP, STEPS, VehiclePlan
from olne_bench.games.solve.reference_game import FAR_AWAY, Plan

LENGTH, WIDTH = 5.0, 2.0  # [m] of a car
NOBODY = np.full((NUM_OTHERS, STEPS, 2), FAR_AWAY)


def solution(*starts: tuple[float, float, float, float], converged: bool = True) -> Plan:
    """Cars that go straight on."""
    state = np.array(starts)
    way = state[:, 3:] * np.column_stack([np.cos(state[:, 2]), np.sin(state[:, 2])])
    states = np.repeat(state[None], STEPS + 1, axis=0)
    states[..., :2] += PLAN_STEP * np.arange(STEPS + 1)[:, None, None] * way
    return Plan(states, np.zeros((STEPS, len(state), 2)), 0.0, 3, converged)


def chosen(
    plan: Plan, start: VehiclePlan | None = None, others: np.ndarray = NOBODY, index: int = 0
) -> tuple[VehiclePlan | None, tuple[int, int, int]]:
    """The chosen plan of a player, and the counts of the report."""
    report = TrafficReport()
    everybodys = np.repeat(others[None], plan.states.shape[1], axis=0)
    collides = joint_planning._run_into_something(plan.states, everybodys)
    assert collides.shape == (plan.states.shape[1],)
    following = joint_planning._next_plan(plan, index, bool(collides[index]), start, report)
    return following, (report.solved, report.shifted, report.braked)


def old_plan(shifts: int) -> VehiclePlan:
    return VehiclePlan(np.zeros((STEPS + 1, 4)), np.zeros((STEPS, 2)), shifts)


def test_an_equilibrium_is_driven() -> None:
    plan = solution((0.0, 0.0, 0.0, 10.0), (0.0, 4.0, 0.0, 12.0))
    for index in (0, 1):
        following, counts = chosen(plan, old_plan(0), index=index)
        assert following is not None and counts == (1, 0, 0)
        np.testing.assert_array_equal(following.states, plan.states[:, index])
        np.testing.assert_array_equal(following.controls, plan.controls[:, index])
        assert following.shifts == 0


@pytest.mark.parametrize(
    ("shifts", "counts"), [(1, (0, 1, 0)), (3, (0, 1, 0)), (4, (0, 0, 1)), (None, (0, 0, 1))]
)
def test_without_one_an_old_plan_serves_for_some_steps(
    shifts: int | None, counts: tuple[int, int, int]
) -> None:
    start = None if shifts is None else old_plan(shifts)
    following, found = chosen(solution((0.0, 0.0, 0.0, 10.0), converged=False), start)
    assert found == counts
    assert following is (start if counts[1] else None)


@pytest.mark.parametrize("heading", [0.0, 0.7, -2.5])
@pytest.mark.parametrize(
    ("ahead", "beside", "contact"),
    [
        (0.9 * LENGTH, 0.0, True),
        (1.1 * LENGTH, 0.0, False),
        (-0.5 * LENGTH, 0.0, False),  # the one behind must avoid it
        (0.5 * LENGTH, 0.85 * WIDTH, True),
        (0.5 * LENGTH, -0.85 * WIDTH, True),
        (0.5 * LENGTH, 0.95 * WIDTH, False),
        (0.5 * LENGTH, -0.95 * WIDTH, False),
        (0.1 * LENGTH, 0.5 * WIDTH, True),
    ],
)
def test_nobody_drives_into_what_is_ahead(
    heading: float, ahead: float, beside: float, contact: bool
) -> None:
    along = np.array([np.cos(heading), np.sin(heading)])
    offset = ahead * along + beside * np.array([-along[1], along[0]])
    own = (3.0, -2.0, heading, 10.0)
    x, y = np.array(own[:2]) + offset
    expected = (0, 0, 1) if contact else (1, 0, 0)
    both = solution((x, y, heading, 10.0), own)
    assert chosen(both, index=1)[1] == expected
    # The same for a predicted vehicle.
    others = NOBODY.copy()
    others[1] = both.states[1:, 0, :2]
    assert chosen(solution(own), others=others)[1] == expected


def test_contact_where_the_plan_begins_is_past() -> None:
    plan = solution((0.0, 0.0, 0.0, 10.0), (3.0, 0.0, 0.0, 30.0))
    assert chosen(plan)[1] == (1, 0, 0)


def road_with(*starts: tuple[float, float, float], **options: object) -> Road:
    road = Road(RoadNetwork.straight_road_network(2, speed_limit=30))
    for x, y, speed in starts:
        car = NashVehicle(road, [x, y], speed=speed, target_speed=25, **options)
        road.vehicles.append(car)
    return road


def test_nobody_jumps_over_somebody_between_two_steps() -> None:
    """Contact between two steps counts as well."""
    own = (0.0, 0.0, 0.0, 6 / PLAN_STEP)  # six metres a step
    others = NOBODY.copy()
    others[0] = [11.99, 0.0]  # a hair behind where the second step ends
    assert chosen(solution(own), others=others)[1] == (0, 0, 1)
    others[0] = [11.99, 2.0]
    assert chosen(solution(own), others=others)[1] == (1, 0, 0)


def test_everybody_whose_plan_is_due_gets_one() -> None:
    road = road_with((100.0, 0.0, 20.0), (110.0, 4.0, 20.0), (900.0, 0.0, 20.0))
    plan_together(road)
    assert all(vehicle.plan is not None for vehicle in road.vehicles)
    report = traffic_report(road)
    assert (report.solved, report.shifted, report.braked) == (3, 0, 0)
    assert [(size, len(times)) for size, times in report.seconds.items()] == [(3, 1)]
    assert 0 < report.seconds[3][0] < 60
    for vehicle in road.vehicles:
        states = vehicle.plan.states
        assert states.shape == (STEPS + 1, 4)
        np.testing.assert_allclose(states[0], vehicle.state())
        assert 20 < states[-1, 3] <= 26  # towards its target speed
        assert abs(states[-1, 1] - vehicle.position[1]) < 1.5  # in its lane


def test_the_haste_of_a_driver_is_a_factor_on_its_speed() -> None:
    ends = []
    for haste in (0.8, 1.0, 1.2):
        road = road_with((100.0, 0.0, 25.0))
        road.vehicles[0].temperament = Temperament(haste=haste)
        references = joint_planning._references(road.vehicles, [None])[0]
        assert references.shape == (STEPS, 4)
        np.testing.assert_allclose(references[:, 3], 25 * haste)
        np.testing.assert_allclose(references[:, 1:3], 0, atol=1e-9)
        steps = np.diff(references[:, 0])
        np.testing.assert_allclose(steps, 25 * PLAN_STEP)
        assert references[0, 0] == pytest.approx(100 + 25 * PLAN_STEP)
        ends.append(references[-1, 3])
    assert ends == sorted(ends)


def test_a_vehicle_in_reverse_looks_at_where_it_is() -> None:
    road = road_with((100.0, 0.0, -5.0))
    references = joint_planning._references(road.vehicles, [None])[0]
    np.testing.assert_allclose(references[:, 0], 100.0)

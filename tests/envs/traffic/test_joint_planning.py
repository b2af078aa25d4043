"""Vehicles plan together in groups of neighbours, among predictions of the others."""

from dataclasses import replace

import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Landmark, Obstacle

from olne_bench.envs.traffic import NashVehicle, Temperament, joint_planning, traffic_report
from olne_bench.envs.traffic.joint_planning import (
    MAX_PLAYERS,
    NEIGHBOURHOOD,
    NUM_OTHERS,
    SIGHT,
    TrafficReport,
    nearest_predictions,
    plan_together,
    planning_groups,
    predicted_positions,
)
from olne_bench.envs.traffic.planning_vehicle import PLAN_STEP, STEPS, PlanningVehicle, VehiclePlan
from olne_bench.games.model.dynamics import bicycle, rollout
from olne_bench.games.solve.reference_game import FAR_AWAY, Plan

TIMES = PLAN_STEP * np.arange(1, STEPS + 1)


@pytest.fixture
def road() -> Road:
    network = RoadNetwork.straight_road_network(2, speed_limit=30)
    return Road(network, np_random=np.random.default_rng(0))


def planning(road: Road, px: float, py: float = 0.0) -> PlanningVehicle:
    vehicle = PlanningVehicle(road, [px, py], speed=20.0)
    road.vehicles.append(vehicle)
    return vehicle


def plan_from(px: float) -> VehiclePlan:
    states = np.zeros((STEPS + 1, 4))
    states[:, 0] = px + 8.0 * np.arange(STEPS + 1)
    states[:, 3] = 20.0
    return VehiclePlan(states, np.zeros((STEPS, 2)))


def test_the_first_vehicle_plans_with_those_nearest_to_it(road) -> None:
    distances = [30.0, -10.0, 45.0, 20.0, -40.0, 25.0]
    vehicle = planning(road, 200.0)
    others = {d: planning(road, 200 + d) for d in distances}
    first, second, third = planning_groups(road)
    assert len(first) == MAX_PLAYERS
    assert first[0] is vehicle
    assert [other.position[0] - 200 for other in first[1:]] == [-10.0, 20.0, 25.0, 30.0]
    assert (second, third) == ([others[45.0]], [others[-40.0]])  # 85 m apart


def test_only_who_is_near_and_whole_and_due_plans_along(road) -> None:
    vehicle = planning(road, 100.0)
    near, crashed, busy = planning(road, 110.0), planning(road, 120.0), planning(road, 130.0)
    far = planning(road, 100 + NEIGHBOURHOOD + 1)
    crashed.crashed = True
    busy.adopt(plan_from(130.0))
    road.vehicles.append(IDMVehicle(road, [90.0, 0.0], speed=20.0))
    assert planning_groups(road) == [[vehicle, near], [far]]


def test_nobody_is_due_on_an_empty_road(road) -> None:
    assert planning_groups(road) == []


def begins(found: np.ndarray, speeds: list[float]) -> list[list[float]]:
    """Starts of predictions (M, T-1, 2), a step before their first place."""
    steps = PLAN_STEP * np.array([[speed, 0.0] for speed in speeds])
    return (found[: len(speeds), 0] - steps).tolist()


def test_who_comes_nearest_is_avoided_but_the_group_and_landmarks(road) -> None:
    vehicle, member = planning(road, 100.0), planning(road, 110.0)
    road.vehicles.append(Vehicle(road, [130.0, 4.0], speed=10.0))
    road.vehicles.append(Vehicle(road, [100 + SIGHT + 5, 0.0], speed=0.0))
    road.objects += [Obstacle(road, [150.0, 0.0]), Landmark(road, [105.0, 0.0])]
    found = nearest_predictions(road, [[vehicle, member]])
    assert found.shape == (2, NUM_OTHERS, STEPS, 2)
    # Both are met within a plan; the obstacle is in the lane, the car one lane beside it.
    assert begins(found[0], [0.0, 10.0]) == [[150, 0], [130, 4]]
    assert (found[0, 2:] == FAR_AWAY).all()  # the fourth is out of sight from the first
    far = 100 + SIGHT + 5
    assert begins(found[1], [0.0, 0.0, 10.0]) == [[150, 0], [far, 0], [130, 4]]


def test_a_wreck_in_the_lane_comes_before_nearer_ones_beside_it(road) -> None:
    vehicle = planning(road, 100.0)
    road.objects += [Obstacle(road, [x, 4.0]) for x in (120.0, 125.0, 130.0)]
    road.objects.append(Obstacle(road, [140.0, 0.0]))
    (found,) = nearest_predictions(road, [[vehicle]])
    assert begins(found, [0.0])[0] == [140, 0]


def test_another_group_is_avoided_and_only_so_many(road) -> None:
    vehicle, other = planning(road, 100.0), planning(road, 160.0)
    road.objects += [Obstacle(road, [100.0 + d, 0.0]) for d in (40.0, -20.0, 70.0)]
    found = nearest_predictions(road, [[vehicle], [other]])
    # What stands on the way ahead, then who drives on it; not what is behind.
    assert begins(found[0], [0.0, 0.0, 20.0]) == [[140, 0], [170, 0], [160, 0]]
    assert begins(found[1], [0.0]) == [[170, 0]] and (found[1, 1:] == FAR_AWAY).all()


def test_who_drives_behind_is_left_to_answer(road) -> None:
    vehicle = planning(road, 100.0)
    for x, y in ((85.0, 0.0), (85.0, 4.0), (98.0, 0.0)):  # behind, beside, and in contact
        road.vehicles.append(Vehicle(road, [x, y], speed=25.0))
    (found,) = nearest_predictions(road, [[vehicle]])
    assert begins(found, [25.0, 25.0]) == [[98, 0], [85, 4]]
    assert (found[2:] == FAR_AWAY).all()


@pytest.mark.parametrize(("age", "first"), [(0.0, 1), (0.15, 1), (0.25, 2), (0.4, 2)])
def test_who_has_a_plan_is_expected_to_keep_it(road, age, first) -> None:
    """Its plan counts from the plan step nearest to its age."""
    other, plan = planning(road, 100.0), plan_from(100.0)
    other.adopt(plan)
    other.plan_age = age
    np.testing.assert_allclose(
        predicted_positions(other)[:, 0], 100 + 8.0 * (first + np.arange(STEPS))
    )


def test_who_has_none_keeps_its_speed_and_its_place_on_the_lane(road) -> None:
    for other in (planning(road, 100.0, 1.0), Vehicle(road, [100.0, 1.0], speed=20.0)):
        other.heading = 0.2  # for a moment only
        expected = np.column_stack([100 + 20 * TIMES, np.ones(STEPS)])
        np.testing.assert_allclose(predicted_positions(other), expected)


def test_who_crashed_goes_straight_on_and_obstacles_stand(road) -> None:
    other = planning(road, 100.0)
    other.adopt(plan_from(100.0))
    other.crashed, other.heading = True, 0.3
    slides = np.array([100.0, 0.0]) + 20 * TIMES[:, None] * [np.cos(0.3), np.sin(0.3)]
    np.testing.assert_allclose(predicted_positions(other), slides)
    stands = predicted_positions(Obstacle(road, [50.0, 4.0]))
    np.testing.assert_allclose(stands, np.full((STEPS, 2), [50.0, 4.0]))


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
    collides, way = joint_planning._run_into_something(plan.states, everybodys)
    assert collides.shape == way.shape == (plan.states.shape[1],)
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


@pytest.mark.parametrize("turned", [0.5, 1.57, 2.6, -1.2])
@pytest.mark.parametrize("late", [-1.5, 0.0, 1.5])
def test_of_two_that_cross_one_gives_way(turned: float, late: float) -> None:
    """One sees the other more ahead than it is seen; among predicted cars it gives way itself."""
    start = 20.0 + late
    other = (-start * np.cos(turned), -start * np.sin(turned), turned, 10.0)
    own = (-20.0, 0.0, 0.0, 10.0)
    both = solution(own, other)
    nobody = np.repeat(NOBODY[None], 2, axis=0)
    collides, way = joint_planning._run_into_something(both.states, nobody)
    assert collides.sum() == 1 and np.isfinite(way).tolist() == collides.tolist()
    assert 10 < way[collides][0] < 21
    others = NOBODY.copy()
    others[2] = both.states[1:, 1, :2]
    alone = solution(own)
    collides, way = joint_planning._run_into_something(alone.states, others[None])
    assert collides[0] and 10 < way[0] < 21
    others[2] += 40 * np.array([np.cos(turned), np.sin(turned)])  # it is far beyond
    assert not joint_planning._run_into_something(alone.states, others[None])[0][0]


def test_who_gives_way_stops_before_the_other_if_it_can() -> None:
    road = road_with((100.0, 0.0, 10.0))
    (car,) = road.vehicles
    for room, expected in ((np.inf, 0.5), (12.5, -4.0), (1.0, -car.ACC_MAX)):
        car.adopt(None, room)
        car.act()
        if np.isinf(room):
            assert car.action["acceleration"] > expected
        else:
            assert car.action["acceleration"] == pytest.approx(expected)


def test_who_enters_later_plans_along_from_the_next_plans_on() -> None:
    road = road_with((100.0, 0.0, 20.0), (120.0, 4.0, 20.0))
    frames = round(PLAN_STEP * 15)
    for frame in range(2 * frames):
        if frame == 2:
            road.vehicles.append(NashVehicle(road, [140.0, 0.0], speed=20.0, target_speed=25))
        due = sum(len(group) for group in planning_groups(road))
        assert due == {0: 2, 2: 1, frames: 3}.get(frame, 0)
        road.act()
        road.step(1 / 15)


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


def test_a_shifted_plan_is_the_rest_and_a_step_of_coasting() -> None:
    rng = np.random.default_rng(0)
    states, controls = rng.uniform(-1, 1, (5, 4)), rng.uniform(-1, 1, (4, 2))
    plan = VehiclePlan(states.copy(), controls.copy())
    once, twice = plan.rest, plan.rest.rest
    assert (plan.shifts, once.shifts, twice.shifts) == (0, 1, 2)
    np.testing.assert_array_equal(once.states[:-1], states[1:])
    np.testing.assert_array_equal(once.controls, [*controls[1:], [0, 0]])
    np.testing.assert_array_equal(twice.states[:-2], states[2:])
    np.testing.assert_array_equal(plan.states, states)
    coasted = rollout(bicycle(), states[None, -1], np.zeros((1, 1, 2)), PLAN_STEP)[-1, 0]
    np.testing.assert_allclose(once.states[-1], coasted, atol=1e-12)


@pytest.mark.parametrize(("gap", "speed", "hard"), [(30.0, 10.0, False), (12.0, 10.0, True)])
def test_a_plan_does_not_keep_a_car_from_braking_when_that_is_due(road, gap, speed, hard) -> None:
    vehicle = NashVehicle(road, [100.0, 0.0], speed=20.0)
    road.vehicles.append(vehicle)
    road.vehicles.append(Vehicle(road, [100.0 + gap + Vehicle.LENGTH, 0.0], speed=speed))
    vehicle.choose_lane()
    vehicle.adopt(plan_from(100.0))  # goes on
    vehicle.act()
    needed = (20 - speed) ** 2 / (2 * (gap - 1))
    assert vehicle.action["acceleration"] == pytest.approx(-min(needed, 6.0) if hard else 0.0)
    road.vehicles[-1].speed = 25.0
    vehicle.act()
    assert vehicle.action["acceleration"] == 0


def test_a_group_without_an_equilibrium_answers_one_by_one(road, monkeypatch) -> None:
    cars = [planning(road, 100.0), planning(road, 130.0)]
    solve, groups = joint_planning._solve, []

    def without(situations, starts):
        groups.append([len(one.references) for one in situations])
        found = solve(situations, starts)
        return [replace(one, converged=one.converged and one.states.shape[1] == 1) for one in found]

    monkeypatch.setattr(joint_planning, "_solve", without)
    joint_planning.plan_together(road)
    assert groups == [[2], [1, 1]]
    assert all(car.plan is not None for car in cars)
    assert traffic_report(road).solved == 2

"""Groups of vehicles that plan together, and predictions of all others."""

import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Landmark, Obstacle

from olne_bench.envs.traffic.joint_planning import (
    MAX_PLAYERS,
    NEIGHBOURHOOD,
    NUM_OTHERS,
    SIGHT,
    nearest_predictions,
    planning_groups,
    predicted_positions,
)
from olne_bench.envs.traffic.planning_vehicle import PLAN_STEP, STEPS, PlanningVehicle, VehiclePlan
from olne_bench.games.solve.reference_game import FAR_AWAY

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


def test_the_nearest_are_avoided_but_the_group_and_landmarks(road) -> None:
    vehicle, member = planning(road, 100.0), planning(road, 110.0)
    road.vehicles.append(Vehicle(road, [130.0, 4.0], speed=10.0))
    road.vehicles.append(Vehicle(road, [100 + SIGHT + 5, 0.0], speed=0.0))
    road.objects += [Obstacle(road, [150.0, 0.0]), Landmark(road, [105.0, 0.0])]
    found = nearest_predictions(road, [[vehicle, member]])
    assert found.shape == (2, NUM_OTHERS, STEPS, 2)
    assert begins(found[0], [10.0, 0.0]) == [[130, 4], [150, 0]]
    assert (found[0, 2:] == FAR_AWAY).all()  # the fourth is out of sight from the first
    assert begins(found[1], [10.0, 0.0, 0.0]) == [[130, 4], [150, 0], [100 + SIGHT + 5, 0]]


def test_another_group_is_avoided_and_only_so_many(road) -> None:
    vehicle, other = planning(road, 100.0), planning(road, 160.0)
    road.objects += [Obstacle(road, [100.0 + d, 0.0]) for d in (40.0, -20.0, 70.0)]
    found = nearest_predictions(road, [[vehicle], [other]])
    assert begins(found[0], [0.0, 0.0, 20.0]) == [[80, 0], [140, 0], [160, 0]]
    assert begins(found[1], [0.0, 0.0, 20.0]) == [[170, 0], [140, 0], [100, 0]]


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

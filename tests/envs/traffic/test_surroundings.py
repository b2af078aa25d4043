"""Who plans with a vehicle, and what everybody else is expected to do."""

import numpy as np
import pytest
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Landmark, Obstacle

from olne_bench.envs.traffic.planning_vehicle import PlanningVehicle
from olne_bench.envs.traffic.surroundings import (
    MAX_PLAYERS,
    NEIGHBOURHOOD,
    NUM_OTHERS,
    SIGHT,
    nearest_predictions,
    planning_group,
    predicted_positions,
    predictions_around,
)
from olne_bench.envs.traffic.vehicle_plan import PLAN_STEP, STEPS, VehiclePlan
from olne_bench.games.reference_game import FAR_AWAY

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


def test_the_nearest_plan_together_the_vehicle_first(road) -> None:
    distances = [30.0, -10.0, 45.0, 20.0, -40.0, 25.0]
    vehicle = planning(road, 200.0)
    others = {d: planning(road, 200 + d) for d in distances}
    group = planning_group(vehicle)
    assert len(group) == MAX_PLAYERS
    assert group[0] is vehicle
    assert [other.position[0] - 200 for other in group[1:]] == [-10.0, 20.0, 25.0, 30.0]
    assert planning_group(others[-40.0])[0] is others[-40.0]


def test_only_who_is_near_and_whole_and_due_plans_along(road) -> None:
    vehicle = planning(road, 100.0)
    near, crashed, busy = planning(road, 110.0), planning(road, 120.0), planning(road, 130.0)
    planning(road, 100 + NEIGHBOURHOOD + 1)
    crashed.crashed = True
    busy.adopt(plan_from(130.0))
    road.vehicles.append(IDMVehicle(road, [90.0, 0.0], speed=20.0))
    assert planning_group(vehicle) == [vehicle, near]


def test_everybody_near_is_predicted_but_the_group_and_landmarks(road) -> None:
    vehicle, member = planning(road, 100.0), planning(road, 110.0)
    road.vehicles.append(Vehicle(road, [120.0, 4.0], speed=10.0))
    reach = SIGHT + NEIGHBOURHOOD
    road.vehicles += [Vehicle(road, [100 + reach + d, 0.0], speed=1.0) for d in (-1.0, 1.0)]
    road.objects += [Obstacle(road, [150.0, 0.0]), Landmark(road, [105.0, 0.0])]
    predicted = predictions_around([vehicle, member])
    assert all(path.shape == (STEPS, 2) for path in predicted)
    starts = [
        path[0] - PLAN_STEP * np.array([speed, 0])
        for path, speed in zip(predicted, (10, 1, 0), strict=True)
    ]
    np.testing.assert_allclose(starts, [[120, 4], [100 + reach - 1, 0], [150, 0]])


def test_the_nearest_predictions_fill_the_slots_and_the_rest_is_far_away(road) -> None:
    vehicle = planning(road, 100.0)
    paths = [np.full((STEPS, 2), [100.0 + d, 0.0]) for d in (SIGHT + 1, 30.0, -5.0, SIGHT - 1)]
    found = nearest_predictions(vehicle, paths)
    np.testing.assert_array_equal(found, [paths[2], paths[1], paths[3]])
    assert len(found) == NUM_OTHERS
    few = nearest_predictions(vehicle, paths[:2])
    np.testing.assert_array_equal(few[0], paths[1])
    assert (few[1:] == FAR_AWAY).all()
    crowd = [*paths, np.full((STEPS, 2), [101.0, 0.0])]
    np.testing.assert_array_equal(nearest_predictions(vehicle, crowd)[0], crowd[-1])


@pytest.mark.parametrize(("age", "first"), [(0.0, 1), (0.15, 1), (0.25, 2), (0.4, 2)])
def test_who_has_a_plan_is_expected_to_keep_it(road, age, first) -> None:
    """From the plan step nearest to its age."""
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

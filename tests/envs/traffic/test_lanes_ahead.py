"""Lanes ahead of a vehicle, and controls that pursue them."""

import numpy as np
import pytest
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.controller import ControlledVehicle
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.traffic.lanes_ahead import (
    CURVE_ACCELERATION,
    MAX_CURVATURE,
    PURSUIT_TIME,
    curve_speeds,
    points_along_lanes,
    pursuit_controls,
)
from olne_bench.envs.traffic.planning_vehicle import PLAN_STEP, STEPS
from olne_bench.games.model.dynamics import bicycle, rollout


def arc(radius: float, step: float, count: int = 8) -> np.ndarray:
    """Points (count, 3) on a circle, ``step`` apart along it."""
    angles = 3.0 + step / radius * np.arange(count)  # beyond pi, where directions wrap
    direction = (angles + np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), direction])


@pytest.mark.parametrize("step", [2.0, 8.0])
@pytest.mark.parametrize("radius", [20.0, 60.0])
def test_a_curve_is_driven_at_its_acceleration_across(radius: float, step: float) -> None:
    speeds = curve_speeds(arc(radius, step)[None])[0]
    assert speeds.shape == (8,)
    np.testing.assert_allclose(speeds**2 / radius, CURVE_ACCELERATION, rtol=0.01)


def test_curves_slow_down_where_they_are_and_no_more_than_the_sharpest() -> None:
    points = np.array([[0, 0, 0], [5, 0, 0], [10, 0, 1.5], [15, 0, 1.5], [20, 0, 1.5]])
    speeds = curve_speeds(points[None])[0]
    slowest = np.sqrt(CURVE_ACCELERATION / MAX_CURVATURE)
    assert speeds[1] == pytest.approx(slowest)
    assert (speeds[[0, 2, 3, 4]] > 100).all()


def test_who_hardly_moves_sees_no_curve() -> None:
    points = np.array([[0, 0, 0.0], [0.01, 0, 0.02], [0.02, 0, 0.04]])
    np.testing.assert_allclose(curve_speeds(points[None])[0], np.sqrt(CURVE_ACCELERATION / 0.02))


@pytest.fixture
def network() -> RoadNetwork:
    """East for 100 m, 2 m further east for 50 m more, or off on a curve to the left."""
    network = RoadNetwork()
    network.add_lane("a", "b", StraightLane([0, 0], [100, 0], speed_limit=30))
    network.add_lane("b", "c", StraightLane([98, 0], [148, 0], speed_limit=15))
    network.add_lane("b", "d", CircularLane([100, 20], 20, -np.pi / 2, 0, speed_limit=None))
    return network


def ahead(network, distances, position=(0, 0), route=None, lateral=0.0):
    distances = np.array(distances, dtype=float)
    where = np.array(position, dtype=float)
    return points_along_lanes(network, ("a", "b", 0), route, where, distances, lateral)


def test_points_lie_on_the_lane_beside_its_middle(network) -> None:
    points, limits = ahead(network, [10, 30], position=(20, 3), lateral=-1.5)
    np.testing.assert_allclose(points, [[30, -1.5, 0], [50, -1.5, 0]])
    assert list(limits) == [30, 30]


def test_a_route_goes_on_where_the_old_lane_ends_on_the_next(network) -> None:
    """The next lane overlaps by two metres: distances continue."""
    route = [("a", "b", 0), ("b", "c", 0)]
    points, limits = ahead(network, [5, 10, 30], position=(90, 0), route=route)
    np.testing.assert_allclose(points[:, :2], [[95, 0], [100, 0], [120, 0]])
    assert list(limits) == [30, 30, 15]


def test_a_curve_turns_and_may_have_no_limit(network) -> None:
    route = [("a", "b", 0), ("b", "d", 0)]
    quarter = 20 * np.pi / 4
    points, limits = ahead(network, [quarter, 2 * quarter], position=(100, 0), route=route)
    np.testing.assert_allclose(
        points, [[100 + 20 / 2**0.5, 20 - 20 / 2**0.5, np.pi / 4], [120, 20, np.pi / 2]], atol=1e-9
    )
    assert list(limits) == [np.inf, np.inf]


def test_the_last_lane_goes_on_for_ever(network) -> None:
    route = [("a", "b", 0), ("b", "c", 0)]
    points, limits = ahead(network, [300], position=(50, 0), route=route)
    np.testing.assert_allclose(points, [[350, 0, 0]])
    assert list(limits) == [15]


def test_who_has_left_its_route_takes_a_lane_that_follows(network) -> None:
    points, _ = ahead(network, [30], position=(90, 0), route=[("x", "y", 0), ("y", "z", 0)])
    assert np.isfinite(points).all()
    assert points[0, 0] > 100


CAR = bicycle(rear_axle=Vehicle.LENGTH / 2)


def along(angle: float, speed: float) -> np.ndarray:
    """References (T-1, 4) on a straight lane through the origin."""
    distances = PLAN_STEP * speed * np.arange(1, STEPS + 1)
    lane = distances[:, None] * [np.cos(angle), np.sin(angle)]
    return np.column_stack([lane, np.full(STEPS, angle), np.full(STEPS, speed)])


def drive(state: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """States (T, 4)."""
    return rollout(CAR, state[None], controls[:, None], PLAN_STEP)[:, 0]


def test_who_is_on_the_lane_drives_straight_on() -> None:
    state = np.array([0, 0, 0.7, 20.0])
    assert np.abs(pursuit_controls(state, along(0.7, 20.0))).max() < 1e-12


@pytest.mark.parametrize("heading", [0.0, 0.1, 2 * np.pi - 0.1])
@pytest.mark.parametrize("beside", [0.5, -3.0])
def test_who_is_beside_it_comes_back_at_constant_speed(beside: float, heading: float) -> None:
    controls = pursuit_controls(np.array([0, beside, heading, 20.0]), along(0.0, 20.0))
    assert (controls[:, 1] == 0).all()
    driven = drive(np.array([0, beside, heading, 20.0]), controls)
    assert abs(driven[-1, 1]) < 0.15 * abs(beside) + 0.15
    assert abs(np.sin(driven[-1, 2])) < 0.05


@pytest.mark.parametrize("angle", [0.0, 1.0, -2.5])
def test_a_turned_or_mirrored_road_is_driven_alike(angle: float) -> None:
    plain = pursuit_controls(np.array([0, 2.0, 0.1, 15.0]), along(0.0, 15.0))
    place = 2.0 * np.array([-np.sin(angle), np.cos(angle)])
    turned = pursuit_controls(np.array([*place, angle + 0.1, 15.0]), along(angle, 15.0))
    np.testing.assert_allclose(turned, plain, atol=1e-9)
    mirrored = pursuit_controls(np.array([0, -2.0, -0.1, 15.0]), along(0.0, 15.0))
    np.testing.assert_allclose(mirrored, -plain, atol=1e-9)


def test_later_controls_are_those_of_where_the_car_will_be() -> None:
    state, references = np.array([0, 1.5, -0.1, 12.0]), along(0.0, 12.0)
    controls = pursuit_controls(state, references)
    driven = drive(state, controls)
    for t in range(1, STEPS):
        again = pursuit_controls(driven[t], references[t:])
        np.testing.assert_allclose(again[: STEPS - t], controls[t:], atol=1e-9)


@pytest.mark.parametrize("beside", [0.4, -0.3])
@pytest.mark.parametrize("speed", [8.0, 25.0])
def test_the_law_is_that_of_the_simulator(beside: float, speed: float) -> None:
    road = Road(RoadNetwork.straight_road_network(1), np_random=np.random.default_rng(0))
    vehicle = ControlledVehicle(road, [50, beside], heading=0.05, speed=speed)
    vehicle.KP_LATERAL, vehicle.KP_HEADING = 1 / PURSUIT_TIME, 1 / (2 * PLAN_STEP)
    state = np.array([0, beside, 0.05, speed])
    steering = pursuit_controls(state, along(0.0, speed))[0, 0]
    np.testing.assert_allclose(steering, vehicle.steering_control(vehicle.lane_index), atol=1e-9)


@pytest.mark.parametrize("speed", [0.0, 30.0])
def test_steering_is_bounded_wherever_one_starts(speed: float) -> None:
    state = np.array([0, 50.0, 3.0, speed])
    steering = np.abs(pursuit_controls(state, along(0.0, speed))[:, 0])
    assert steering.max() <= np.arctan(2 * np.tan(np.arcsin(0.4))) + 1e-12
    assert steering.max() > 0.1


@pytest.mark.parametrize("speed", [0.5, 6.0])
@pytest.mark.parametrize(("beside", "heading"), [(9.0, 0.0), (0.0, 1.5), (-9.0, 1.5), (2.0, -0.8)])
def test_turns_are_as_sharp_to_either_side_and_bounded(beside, heading, speed) -> None:
    controls, mirrored = (
        pursuit_controls(np.array([0, s * beside, s * heading, speed]), along(0.0, speed))
        for s in (1, -1)
    )
    np.testing.assert_allclose(mirrored, -controls, atol=1e-9)
    sharpest = np.arctan(2 * np.tan(np.arcsin(0.4)))
    assert np.abs(controls).max() <= sharpest + 1e-12
    if abs(heading) > 1:
        assert controls[0, 0] == pytest.approx(-sharpest)

"""Points along a vehicle's lanes, and speeds."""

import numpy as np
import pytest
from highway_env.road.lane import CircularLane, StraightLane
from highway_env.road.road import RoadNetwork

from olne_bench.envs.traffic.lanes_ahead import (
    CURVE_ACCELERATION,
    MAX_CURVATURE,
    curve_speeds,
    points_along_lanes,
)


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
        points,
        [[100 + 20 / 2**0.5, 20 - 20 / 2**0.5, np.pi / 4], [120, 20, np.pi / 2]],
        atol=1e-9,
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

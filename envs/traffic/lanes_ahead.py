"""The lanes ahead of a vehicle: where it will pass, and how fast it may."""

import numpy as np
from highway_env.road.road import LaneIndex, RoadNetwork

CURVE_ACCELERATION = 5.0  # [m/s^2] across, for which drivers slow down in curves
MAX_CURVATURE = 0.1  # [1/m]


def points_along_lanes(
    network: RoadNetwork,
    index: LaneIndex,
    route: list[LaneIndex] | None,
    position: np.ndarray,
    distances: np.ndarray,
    lateral: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Points at distances (S,) ahead of a position, along a lane and the lanes that follow it.

    The last lane is extended beyond its end.

    Returns:
        Points (S, 3) px, py, direction, and the speed limit (S,) [m/s] at each.
    """
    lane = network.get_lane(index)
    before, _ = lane.local_coordinates(position)
    points, limits = [], []
    ahead = list(route) if route else None
    for distance in distances:
        while before + distance > lane.length:
            end = lane.position(lane.length, 0)
            if ahead and index[:2] != ahead[0][:2] and index[1] != ahead[0][0]:
                ahead = None  # the vehicle has left its route
            following = network.next_lane(index, ahead, end)
            if following == index:
                break
            # Lanes need not touch, hence the place of the old one's end on the new one.
            passed = lane.length - before
            index, lane = following, network.get_lane(following)
            before = lane.local_coordinates(end)[0] - passed
        place = before + distance
        points.append([*lane.position(place, lateral), lane.heading_at(place)])
        limits.append(np.inf if lane.speed_limit is None else lane.speed_limit)
    return np.array(points), np.array(limits)


def curve_speeds(points: np.ndarray) -> np.ndarray:
    """Speeds (T-1,) [m/s] at which the curve through points (T-1, 3) is comfortable."""
    step = np.hypot(*np.diff(points[:, :2], axis=0).T)
    turn = np.abs(np.diff(np.unwrap(points[:, 2])))
    # A vehicle that hardly moves sees no curve; lanes that do not touch make none either.
    curvature = np.clip(turn / np.maximum(step, 1.0), 1e-6, MAX_CURVATURE)
    speeds = np.sqrt(CURVE_ACCELERATION / curvature)
    return np.append(speeds, speeds[-1])

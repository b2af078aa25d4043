"""The lanes ahead of a vehicle: points on them, speeds, and controls that pursue them."""

import numpy as np
from highway_env.road.lane import AbstractLane, SineLane, StraightLane
from highway_env.road.road import LaneIndex, RoadNetwork
from highway_env.utils import wrap_to_pi
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.traffic.planning_vehicle import PLAN_STEP, STEPS

CURVE_ACCELERATION = 5.0  # [m/s^2], largest lateral acceleration in curves
MAX_CURVATURE = 0.1  # [1/m]
PURSUIT_TIME = 1.2  # [s] in which a vehicle without a plan returns to the lane


def points_along_lanes(
    network: RoadNetwork,
    index: LaneIndex,
    route: list[LaneIndex] | None,
    position: np.ndarray,
    distances: np.ndarray,
    lateral: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Points (S, 3) px, py, direction at distances (S,) ahead along lanes, and speed limits (S,).

    The last lane is extended beyond its end.
    """
    points, limits = np.empty((len(distances), 3)), np.empty(len(distances))
    lane = network.get_lane(index)
    before, _ = lane.local_coordinates(position)
    ahead = list(route) if route else None
    done = 0
    while done < len(distances):
        places = before + distances[done:]
        beyond = places > lane.length
        count = int(beyond.argmax()) if beyond.any() else len(places)
        following = index
        if count < len(places):
            end = lane.position(lane.length, 0)
            if ahead and index[:2] != ahead[0][:2] and index[1] != ahead[0][0]:
                ahead = None  # the vehicle has left its route
            following = network.next_lane(index, ahead, end)
        if following == index:
            count = len(places)
        here = slice(done, done + count)
        points[here] = _points_on(lane, places[:count], lateral)
        limits[here] = np.inf if lane.speed_limit is None else lane.speed_limit
        done += count
        if following != index:
            # Lanes need not touch, so the old lane's end is located on the new one.
            passed = lane.length - before
            index, lane = following, network.get_lane(following)
            before = lane.local_coordinates(end)[0] - passed
    return points, limits


def _points_on(lane: AbstractLane, places: np.ndarray, lateral: float) -> np.ndarray:
    """Points (S, 3) px, py, direction at places (S,) [m] along a lane."""
    points = np.empty((len(places), 3))
    if type(lane) in (StraightLane, SineLane):  # HighwayEnv's other lanes take one place at a time
        points[:, :2] = lane.position(places[:, None], lateral)
        points[:, 2] = lane.heading_at(places)
        return points
    for point, place in zip(points, places, strict=True):
        point[:2], point[2] = lane.position(place, lateral), lane.heading_at(place)
    return points


def curve_speeds(points: np.ndarray) -> np.ndarray:
    """Speeds (N, S) [m/s] at which the curves through points (N, S, 3) are comfortable."""
    offsets = np.diff(points[..., :2], axis=1)
    step = np.hypot(offsets[..., 0], offsets[..., 1])
    turn = np.abs(np.diff(np.unwrap(points[..., 2])))
    # A vehicle that hardly moves has no curve ahead, and a gap between lanes is not a curve.
    curvature = np.clip(turn / np.maximum(step, 1.0), 1e-6, MAX_CURVATURE)
    speeds = np.sqrt(CURVE_ACCELERATION / curvature)
    return np.concatenate([speeds, speeds[:, -1:]], axis=1)


def pursuit_controls(state: np.ndarray, references: np.ndarray) -> np.ndarray:
    """Controls (T-1, 2) that pursue references (T-1, 4) at constant speed.

    The law is that of HighwayEnv's ``ControlledVehicle``, with gains for steps this long.
    """
    rear_axle, controls = Vehicle.LENGTH / 2, np.zeros((STEPS, 2))
    px, py, heading, speed = state
    moving = max(speed, 1.0)
    for t, (rx, ry, direction, _) in enumerate(references):
        beside = (py - ry) * np.cos(direction) - (px - rx) * np.sin(direction)
        towards = np.arcsin(np.clip(-beside / (PURSUIT_TIME * moving), -0.5, 0.5))
        error = wrap_to_pi(direction + towards - heading)
        slip = np.arcsin(np.clip(error / (2 * PLAN_STEP) * rear_axle / moving, -0.4, 0.4))
        controls[t, 0] = np.arctan(2 * np.tan(slip))
        px += speed * np.cos(heading + slip) * PLAN_STEP
        py += speed * np.sin(heading + slip) * PLAN_STEP
        heading += speed * np.sin(slip) / rear_axle * PLAN_STEP
    return controls

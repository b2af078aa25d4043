"""Groups of vehicles that plan together, and predictions of all others."""

import numpy as np
from highway_env.road.road import Road
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Landmark, RoadObject

from olne_bench.envs.traffic.lanes_ahead import points_along_lanes
from olne_bench.envs.traffic.planning_vehicle import PlanningVehicle
from olne_bench.envs.traffic.vehicle_plan import PLAN_STEP, STEPS
from olne_bench.games.solve.reference_game import FAR_AWAY

MAX_PLAYERS = 5  # in one game
NEIGHBOURHOOD = 50.0  # [m] around a vehicle in which others plan with it
NUM_OTHERS = 3  # predicted vehicles and obstacles that each player avoids besides the players
SIGHT = 80.0  # [m], largest distance of these


def planning_groups(road: Road) -> list[list[PlanningVehicle]]:
    """All vehicles that plan now, in groups of at most MAX_PLAYERS neighbours.

    The first vehicle on the road without a group forms one with the nearest others without one.
    """
    due = [
        vehicle
        for vehicle in road.vehicles
        if isinstance(vehicle, PlanningVehicle) and not vehicle.crashed and vehicle.is_due()
    ]
    positions = np.array([vehicle.position for vehicle in due])
    groups, free = [], np.ones(len(due), dtype=bool)
    for first in range(len(due)):
        if free[first]:
            distances = np.hypot(*(positions - positions[first]).T)
            distances[~free] = np.inf
            distances[first] = 0.0
            nearest = np.argsort(distances, kind="stable")[:MAX_PLAYERS]
            group = nearest[distances[nearest] < NEIGHBOURHOOD]
            free[group] = False
            groups.append([due[index] for index in group])
    return groups


def nearest_predictions(road: Road, groups: list[list[PlanningVehicle]]) -> np.ndarray:
    """Positions (N, M, T-1, 2) that each of the N members of groups avoids besides its group.

    These are the predictions that start nearest to it.
    """
    around = [entry for entry in (*road.vehicles, *road.objects) if not isinstance(entry, Landmark)]
    paths = np.stack([predicted_positions(other) for other in around])
    group_of = {id(member): index for index, group in enumerate(groups) for member in group}
    theirs = np.array([group_of.get(id(other), -1) for other in around])
    members = [member for group in groups for member in group]
    own = np.array([group_of[id(member)] for member in members])
    offsets = paths[:, 0] - np.array([member.position for member in members])[:, None]
    distances = np.hypot(offsets[..., 0], offsets[..., 1])  # (N, others)
    distances[own[:, None] == theirs] = np.inf
    nearest = np.argsort(distances, axis=1, kind="stable")[:, :NUM_OTHERS]
    found = np.full((len(members), NUM_OTHERS, STEPS, 2), FAR_AWAY)
    row, slot = np.nonzero(np.take_along_axis(distances, nearest, axis=1) < SIGHT)
    found[row, slot] = paths[nearest[row, slot]]
    return found


def predicted_positions(other: RoadObject) -> np.ndarray:
    """The positions (T-1, 2) of a vehicle or obstacle at the next plan steps."""
    if isinstance(other, PlanningVehicle) and not other.crashed and other.plan is not None:
        passed = int(other.plan_age / PLAN_STEP + 0.5)
        plan = other.plan.rest if passed else other.plan
        return plan.states[1:, :2]
    times = PLAN_STEP * np.arange(1, STEPS + 1)
    if not isinstance(other, Vehicle) or other.crashed or other.lane is None:
        return other.position + times[:, None] * other.velocity
    _, lateral = other.lane.local_coordinates(other.position)
    points, _ = points_along_lanes(
        other.road.network,
        other.lane_index,
        getattr(other, "route", None),
        other.position,
        times * other.speed,
        lateral,
    )
    return points[:, :2]

"""Who plans together with a vehicle, and what everybody else is predicted to do."""

import numpy as np
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Landmark, RoadObject

from olne_bench.envs.traffic.lanes_ahead import points_along_lanes
from olne_bench.envs.traffic.planning_vehicle import PlanningVehicle
from olne_bench.envs.traffic.vehicle_plan import PLAN_STEP, STEPS
from olne_bench.games.reference_game import FAR_AWAY

MAX_PLAYERS = 5  # in one game
NEIGHBOURHOOD = 50.0  # [m] around a vehicle in which others plan with it
NUM_OTHERS = 3  # predicted vehicles and obstacles that each player avoids besides the players
SIGHT = 80.0  # [m] up to which these are looked for


def planning_group(vehicle: PlanningVehicle) -> list[PlanningVehicle]:
    """The vehicle and the nearest others that plan now, MAX_PLAYERS at most."""
    near = [
        (float(np.hypot(*(other.position - vehicle.position))), index, other)
        for index, other in enumerate(vehicle.road.vehicles)
        if isinstance(other, PlanningVehicle)
        and other is not vehicle
        and not other.crashed
        and other.is_due()
    ]
    nearest = sorted(entry for entry in near if entry[0] < NEIGHBOURHOOD)[: MAX_PLAYERS - 1]
    return [vehicle, *(other for _, _, other in nearest)]


def predictions_around(group: list[PlanningVehicle]) -> list[np.ndarray]:
    """The positions (T-1, 2) at the next plan steps of everybody near a group but its members."""
    first = group[0]
    return [
        predicted_positions(other)
        for other in [*first.road.vehicles, *first.road.objects]
        if not any(other is member for member in group) and not isinstance(other, Landmark)
        if np.hypot(*(other.position - first.position)) < SIGHT + NEIGHBOURHOOD
    ]


def nearest_predictions(vehicle: PlanningVehicle, predicted: list[np.ndarray]) -> np.ndarray:
    """The predictions (M, T-1, 2) that begin nearest to the vehicle."""
    nearest = np.full((NUM_OTHERS, STEPS, 2), FAR_AWAY)
    distances = [float(np.hypot(*(path[0] - vehicle.position))) for path in predicted]
    for slot, index in enumerate(np.argsort(distances)[:NUM_OTHERS]):
        if distances[index] < SIGHT:
            nearest[slot] = predicted[index]
    return nearest


def predicted_positions(other: RoadObject) -> np.ndarray:
    """The positions (T-1, 2) of a vehicle or obstacle at the next plan steps."""
    if isinstance(other, PlanningVehicle) and not other.crashed and other.plan is not None:
        passed = int(other.plan_age / PLAN_STEP + 0.5)
        plan = other.plan.shifted() if passed else other.plan
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

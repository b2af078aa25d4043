"""One game for the Nash vehicles that are near each other, and a plan for each of them."""

from collections import deque
from collections.abc import Sequence
from functools import lru_cache
from time import perf_counter

import numpy as np
from highway_env.vehicle.kinematics import Vehicle
from threadpoolctl import ThreadpoolController

from olne_bench.envs.traffic.lanes_ahead import curve_speeds, points_along_lanes
from olne_bench.envs.traffic.planning_vehicle import PlanningVehicle
from olne_bench.envs.traffic.pursuit import pursuit_controls
from olne_bench.envs.traffic.report import TrafficReport, traffic_report
from olne_bench.envs.traffic.surroundings import (
    MAX_PLAYERS,
    NUM_OTHERS,
    nearest_predictions,
    planning_group,
    predictions_around,
)
from olne_bench.envs.traffic.vehicle_plan import PLAN_STEP, STEPS, VehiclePlan
from olne_bench.games.reference_game import Plan, ReferenceGame, Situation

MAX_SHIFTS = 3  # plan steps for which an old plan may serve


def plan_together(vehicle: PlanningVehicle) -> None:
    """Give a plan to the vehicle, and to those near it whose plans are due as well."""
    group = planning_group(vehicle)
    for member in group:
        member.choose_lane()
    starts = [member.remaining_plan() for member in group]
    situation = _situation(group, starts)
    report = traffic_report(vehicle.road)
    begin = perf_counter()
    solution = _solve(situation, starts)
    times = report.seconds.setdefault(len(group), deque(maxlen=10_000))
    times.append(perf_counter() - begin)
    for index, (member, start) in enumerate(zip(group, starts, strict=True)):
        member.adopt(_next_plan(solution, situation.others[index], index, start, report))


def _solve(situation: Situation, starts: Sequence[VehiclePlan | None]) -> Plan:
    pursuit = [
        pursuit_controls(*pair)
        for pair in zip(situation.initial_state, situation.references, strict=True)
    ]
    warm = [p if s is None else s.controls for s, p in zip(starts, pursuit, strict=True)]
    # BLAS on several threads is a hundred times slower on matrices this small.
    with _blas().limit(limits=1, user_api="blas"):
        solution = _game().solve(situation, np.stack(warm, axis=1))
        if not solution.converged and any(start is not None for start in starts):
            solution = _game().solve(situation, np.stack(pursuit, axis=1))
    return solution


def _next_plan(
    solution: Plan,
    others: np.ndarray,
    index: int,
    start: VehiclePlan | None,
    report: TrafficReport,
) -> VehiclePlan | None:
    """What one player drives next; None stands for the Intelligent Driver Model.

    The case is counted in the report.
    """
    if solution.converged:
        if not _runs_into_something(solution.states, others, index):
            report.solved += 1
            return VehiclePlan(solution.states[:, index], solution.controls[:, index])
    elif start is not None and start.shifts <= MAX_SHIFTS:
        report.shifted += 1
        return start
    report.braked += 1
    return None


def _runs_into_something(states: np.ndarray, others: np.ndarray, index: int) -> bool:
    """Whether planned states (T, N, 4) bring that player into contact ahead of it.

    Args:
        states: of all players.
        others: (M, T-1, 2) predicted positions of what else the player avoids.
        index: of the player.
    """
    own = states[1:, index]
    players = np.delete(states[1:, :, :2], index, axis=1).swapaxes(0, 1)
    offsets = np.concatenate([players, others]) - own[:, :2]  # (N-1+M, T-1, 2)
    cos, sin = np.cos(own[:, 2]), np.sin(own[:, 2])
    ahead = offsets[..., 0] * cos + offsets[..., 1] * sin
    beside = offsets[..., 1] * cos - offsets[..., 0] * sin
    contact = (ahead > 0) & (ahead < Vehicle.LENGTH) & (np.abs(beside) < 0.9 * Vehicle.WIDTH)
    return bool(contact.any())


def _situation(group: list[PlanningVehicle], starts: Sequence[VehiclePlan | None]) -> Situation:
    predicted = predictions_around(group)
    return Situation(
        initial_state=np.stack([member.state() for member in group]),
        weights=np.stack([member.temperament.weights for member in group]),
        references=np.stack(
            [_references(member, start) for member, start in zip(group, starts, strict=True)]
        ),
        others=np.stack([nearest_predictions(member, predicted) for member in group]),
    )


def _references(vehicle: PlanningVehicle, start: VehiclePlan | None) -> np.ndarray:
    """Points and speeds (T-1, 4) of the target lane and its successors where a vehicle passes."""
    speeds = np.full(STEPS, vehicle.speed) if start is None else start.states[:-1, 3]
    distances = PLAN_STEP * np.cumsum(np.maximum(speeds, 0.0))
    points, limits = points_along_lanes(
        vehicle.road.network,
        vehicle.target_lane_index,
        vehicle.route,
        vehicle.position,
        distances,
        lateral=0.0,
    )
    target = np.minimum(vehicle.target_speed * vehicle.temperament.haste, limits)
    target = np.minimum(target, curve_speeds(points))
    return np.column_stack([points, target])


@lru_cache(maxsize=1)
def _game() -> ReferenceGame:
    return ReferenceGame(
        steps=STEPS,
        dt=PLAN_STEP,
        max_players=MAX_PLAYERS,
        num_others=NUM_OTHERS,
        rear_axle=Vehicle.LENGTH / 2,
    )


@lru_cache(maxsize=1)
def _blas() -> ThreadpoolController:
    return ThreadpoolController()

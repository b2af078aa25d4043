"""Plan for all vehicles of a road whose plans are due: solve the games of groups at once."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from time import perf_counter
from weakref import WeakKeyDictionary

import numpy as np
from highway_env.road.road import Road
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Landmark, RoadObject
from threadpoolctl import ThreadpoolController

from olne_bench.envs.roads.footprint import gap
from olne_bench.envs.traffic.lanes_ahead import curve_speeds, points_along_lanes, pursuit_controls
from olne_bench.envs.traffic.planning_vehicle import (
    ALIKE,
    PLAN_STEP,
    STEPS,
    PlanningVehicle,
    VehiclePlan,
)
from olne_bench.games.solve.reference_game import FAR_AWAY, Plan, ReferenceGame, Situation

MAX_PLAYERS = 5  # in one game
NEIGHBOURHOOD = 50.0  # [m] around a vehicle in which others plan with it
NUM_OTHERS = 3  # predicted vehicles and obstacles that each player avoids besides the players
SIGHT = 80.0  # [m], largest distance of these
MAX_SHIFTS = 3  # plan steps for which an old plan may be used
BETWEEN = 3  # number of points between two plan steps at which contact is checked
_STANDS = 0.1  # [m] in a plan step: the direction of what moves less is not known
_CROSSES = 0.3  # sine of the angle from which on a car crosses
_ROOM = 0.3  # [m] that is kept to one that does
#: Steering [rad] and acceleration [m/s^2]: a Newton step within these is the last one.
SMALL_CHANGE = (2e-3, 0.1)
Group = list[PlanningVehicle]
Starts = list[VehiclePlan | None]


@dataclass
class TrafficReport:
    """Counts of the outcomes of planning on one road."""

    #: Number of vehicle plans that are equilibria, or answers to what others are expected to do.
    solved: int = 0
    shifted: int = 0  # number of times a vehicle continued its previous plan
    #: Number of times a vehicle fell back on the Intelligent Driver Model, as it had no plan or
    #: only one that collides.
    braked: int = 0
    #: The latest solving times [s], by number of vehicles that planned at once.
    seconds: dict[int, deque[float]] = field(default_factory=dict)


_REPORTS: WeakKeyDictionary[Road, TrafficReport] = WeakKeyDictionary()


def traffic_report(road: Road) -> TrafficReport:
    """The report of a road, such as ``env.unwrapped.road``."""
    return _REPORTS.setdefault(road, TrafficReport())


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
    """Predictions (N, M, T-1, 2) that members of groups avoid besides their group.

    Of all in sight, those that come nearest to where a member itself is predicted: a wreck in its
    lane rather than those beside it. Who drives behind a member answers it, not the reverse.
    """
    around = [entry for entry in (*road.vehicles, *road.objects) if not isinstance(entry, Landmark)]
    paths = np.stack([predicted_positions(other) for other in around])
    group_of = {id(member): index for index, group in enumerate(groups) for member in group}
    theirs = np.array([group_of.get(id(other), -1) for other in around])
    members = [member for group in groups for member in group]
    own = np.array([group_of[id(member)] for member in members])
    places = np.array([member.position for member in members])
    unseen = _distances(paths[:, 0], places[:, None]) >= SIGHT
    unseen |= (own[:, None] == theirs) | _behind(members, around)
    expected = np.stack([predicted_positions(member) for member in members])
    nearness = _distances(paths, expected[:, None]).min(axis=2)  # (N, others)
    nearness[unseen] = np.inf
    nearest = np.argsort(nearness, axis=1, kind="stable")[:, :NUM_OTHERS]
    found = np.full((len(members), NUM_OTHERS, STEPS, 2), FAR_AWAY)
    row, slot = np.nonzero(np.isfinite(np.take_along_axis(nearness, nearest, axis=1)))
    found[row, slot] = paths[nearest[row, slot]]
    return found


def _behind(members: Sequence[Vehicle], around: Sequence[RoadObject]) -> np.ndarray:
    """(N, others) who drives behind a member, in its lane and its direction."""
    headings = np.array([member.heading for member in members])[:, None]
    places = np.array([member.position for member in members])[:, None]
    x, y = np.moveaxis(np.array([other.position for other in around]) - places, -1, 0)
    cos, sin = np.cos(headings), np.sin(headings)
    alike = np.cos(np.array([other.heading for other in around]) - headings) > ALIKE
    behind = x * cos + y * sin < -Vehicle.LENGTH / 2
    return np.asarray(alike & behind & (np.abs(y * cos - x * sin) < Vehicle.WIDTH))


def _distances(ones: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Distances (...) [m] between points (..., 2)."""
    return np.asarray(np.linalg.norm(ones - others, axis=-1))


def predicted_positions(other: RoadObject) -> np.ndarray:
    """The positions (T-1, 2) of a vehicle or obstacle at the next plan steps."""
    if isinstance(other, PlanningVehicle) and not other.crashed and other.plan is not None:
        passed = int(other.plan_age / PLAN_STEP + 0.5)
        plan = other.plan.rest if passed else other.plan
        return plan.states[1:, :2]
    times = PLAN_STEP * np.arange(1, STEPS + 1)
    if not isinstance(other, Vehicle) or other.crashed or other.lane is None:
        return np.asarray(other.position + times[:, None] * other.velocity)
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


def plan_together(road: Road) -> None:
    """Give a plan to each vehicle whose plan is due, in games of neighbours."""
    groups = planning_groups(road)
    for group in groups:
        for member in group:
            member.choose_lane()
    _plan(road, groups, _age_of_plans(road))


def _plan(road: Road, groups: list[Group], age: float) -> None:
    """Plan in these groups; members of one without an equilibrium answer what others will do."""
    starts = [[member.remaining_plan() for member in group] for group in groups]
    situations = _situations(road, groups, starts)
    begin = perf_counter()
    solutions = _solve(situations, starts)
    report = traffic_report(road)
    planning = sum(len(group) for group in groups)
    times = report.seconds.setdefault(planning, deque(maxlen=10_000))
    times.append(perf_counter() - begin)
    apart: list[Group] = []
    for group, start, situation, solution in zip(
        groups, starts, situations, solutions, strict=True
    ):
        if len(group) > 1 and not solution.converged:
            apart += [[member] for member in group]
            continue
        collides, room = _run_into_something(solution.states, situation.others)
        for index, member in enumerate(group):
            plan = _next_plan(solution, index, bool(collides[index]), start[index], report)
            member.adopt(plan, float(room[index]), age)
    if apart:
        _plan(road, apart, age)


def _age_of_plans(road: Road) -> float:
    """Age [s] of plans that are not due: who has entered since plans again with the others."""
    cars = [one for one in road.vehicles if isinstance(one, PlanningVehicle) and not one.crashed]
    return min((one.plan_age for one in cars if not one.is_due()), default=0.0)


def _solve(situations: list[Situation], starts: Sequence[Starts]) -> list[Plan]:
    """Solve from previous plans; games that fail are tried again from a pursuit of the lanes."""
    warm = [_first_controls(*pair) for pair in zip(situations, starts, strict=True)]
    # BLAS on several threads is a hundred times slower on matrices this small.
    with _blas().limit(limits=1, user_api="blas"):
        solutions = _game().solve_all(situations, warm, small_change=SMALL_CHANGE)
        again = [
            index
            for index, (solution, start) in enumerate(zip(solutions, starts, strict=True))
            if not solution.converged and any(plan is not None for plan in start)
        ]
        if again:
            failed = [situations[index] for index in again]
            cold = [_first_controls(one, [None] * len(one.references)) for one in failed]
            second = _game().solve_all(failed, cold, small_change=SMALL_CHANGE)
            for index, solution in zip(again, second, strict=True):
                solutions[index] = solution
    return solutions


def _first_controls(situation: Situation, start: Starts) -> np.ndarray:
    """Controls (T-1, N, 2) of previous plans; players without one pursue their lanes."""
    players = zip(start, situation.initial_state, situation.references, strict=True)
    return np.stack(
        [pursuit_controls(*pair) if plan is None else plan.controls for plan, *pair in players],
        axis=1,
    )


def _next_plan(
    solution: Plan, index: int, collides: bool, start: VehiclePlan | None, report: TrafficReport
) -> VehiclePlan | None:
    """One player's next plan, counted in the report; None for the Intelligent Driver Model."""
    if solution.converged:
        if not collides:
            report.solved += 1
            return VehiclePlan(solution.states[:, index], solution.controls[:, index])
    elif start is not None and start.shifts <= MAX_SHIFTS:
        report.shifted += 1
        return start
    report.braked += 1
    return None


def _run_into_something(states: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mask (N,) of plans (T, N, 4) that lead to contact with others (N, M, T-1, 2) ahead.

    Also the way (N,) [m] to the first contact with one that crosses; infinite without one.
    """
    own = np.moveaxis(states[1:, :, :3], 0, -1)  # (N, 3, T-1)
    players = np.broadcast_to(own, (len(own), *own.shape))
    paths = np.concatenate([players, _poses(others, own[:, None, 2])], axis=1)
    # A car covers its own length in less than a step, so points between steps count as well.
    mine, theirs = (np.moveaxis(_with_steps_between(one), 2, 0) for one in (own[:, None], paths))
    (x, y, heading), (px, py, _) = mine, theirs
    cos, sin = np.cos(heading), np.sin(heading)
    ahead = (px - x) * cos + (py - y) * sin  # a player is not ahead of itself
    beside = (py - y) * cos - (px - x) * sin
    contact = (ahead > 0) & (ahead < Vehicle.LENGTH) & (np.abs(beside) < 0.9 * Vehicle.WIDTH)
    crosses = np.abs(np.sin(theirs[2] - heading)) > _CROSSES
    near = crosses & (np.hypot(ahead, beside) < Vehicle.LENGTH + Vehicle.WIDTH)
    if not near.any():  # so whoever is in contact does not cross
        return contact.any(axis=(1, 2)), np.full(len(own), np.inf)
    crossing = np.zeros(near.shape, dtype=bool)
    cars = [np.moveaxis(np.broadcast_to(one, theirs.shape), 0, -1)[near] for one in (mine, theirs)]
    crossing[near] = gap(*cars) < _ROOM
    both = np.s_[:, : len(own)]
    crossing[both] &= _gives_way(crossing[both], ahead[both])
    start = states[0, :, :2, None]
    way = np.hypot(x[:, 0] - start[:, 0], y[:, 0] - start[:, 1])
    way = np.where(crossing.any(axis=1), way, np.inf).min(axis=1)
    return ((contact & ~crosses) | crossing).any(axis=(1, 2)), way


def _gives_way(crossing: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Of two players that would hit each other, who has the other more ahead then: (N, N, 1).

    ``crossing`` says when, ``ahead`` how far [m] the second one is ahead of the first, (N, N, S).
    """
    then = np.take_along_axis(ahead, crossing.argmax(axis=2)[..., None], axis=2)
    back = then.swapaxes(0, 1)
    first = np.tri(len(then), dtype=bool)[..., None]
    return np.asarray((then > back) | ((then == back) & first))


def _poses(paths: np.ndarray, headings: np.ndarray) -> np.ndarray:
    """Positions (N, M, S, 2) and directions as (N, M, 3, S); at a stand, headings (N, 1, S)."""
    dx, dy = np.moveaxis(np.gradient(paths, axis=2), -1, 0)
    moves = np.hypot(dx, dy) > _STANDS
    directions = np.unwrap(np.where(moves, np.arctan2(dy, dx), headings))
    return np.stack([paths[..., 0], paths[..., 1], directions], axis=2)


def _with_steps_between(values: np.ndarray) -> np.ndarray:
    """Values (..., S) at steps, and BETWEEN interpolated ones after each but the last."""
    parts = np.linspace(0.0, 1.0, BETWEEN + 1, endpoint=False)
    change = np.diff(values)[..., None] * parts
    between = values[..., :-1, None] + change
    return np.concatenate([between.reshape(*values.shape[:-1], -1), values[..., -1:]], axis=-1)


def _situations(road: Road, groups: list[Group], starts: Sequence[Starts]) -> list[Situation]:
    members = [member for group in groups for member in group]
    references = _references(members, [plan for start in starts for plan in start])
    others = nearest_predictions(road, groups)
    ends = np.cumsum([len(group) for group in groups])[:-1]
    return [
        Situation(
            initial_state=np.stack([member.state() for member in group]),
            weights=np.stack([member.temperament.weights for member in group]),
            references=those_references,
            others=those_others,
        )
        for group, those_references, those_others in zip(
            groups, np.split(references, ends), np.split(others, ends), strict=True
        )
    ]


def _references(vehicles: list[PlanningVehicle], starts: Starts) -> np.ndarray:
    """Reference points, directions and speeds (N, T-1, 4) along the vehicles' target lanes."""
    speeds = np.stack(
        [
            np.full(STEPS, vehicle.speed) if start is None else start.states[:-1, 3]
            for vehicle, start in zip(vehicles, starts, strict=True)
        ]
    )
    distances = PLAN_STEP * np.cumsum(np.maximum(speeds, 0.0), axis=1)
    found = [
        points_along_lanes(
            vehicle.road.network,
            vehicle.target_lane_index,
            vehicle.route,
            vehicle.position,
            ahead,
            lateral=0.0,
        )
        for vehicle, ahead in zip(vehicles, distances, strict=True)
    ]
    points = np.stack([points for points, _ in found])
    wanted = np.array([vehicle.target_speed * vehicle.temperament.haste for vehicle in vehicles])
    target = np.minimum(wanted[:, None], np.stack([limits for _, limits in found]))
    target = np.minimum(target, curve_speeds(points))
    return np.concatenate([points, target[..., None]], axis=2)


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

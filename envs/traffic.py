"""Traffic for any of HighwayEnv's environments that plays a receding-horizon Nash equilibrium.

Use it from a stock configuration::

    gym.make("highway-v0", config={"other_vehicles_type": "olne_bench.envs.traffic.NashVehicle"})

Every ``PLAN_STEP`` seconds the Nash vehicles near each other solve one open-loop game over the
next ``HORIZON`` seconds, warm-started from their previous plans, and drive its first step. Which
lane to take stays HighwayEnv's discrete decision (MOBIL and the planned route); how to get there,
among others who plan as well, is the game's.

The ego vehicle and everybody else who does not plan is predicted to keep its lane and speed. It
is not a player: its cost is unknown, and a driver that counted on the ego's cooperation would
drive into an ego that does not cooperate. Nash vehicles of another group are predicted to follow
their latest plans.

Where a plan cannot be found the vehicle goes on with the rest of its previous one, and where
that is used up, or where its equilibrium runs into something (costs are finite, so some do), it
drives by the Intelligent Driver Model until the next try. ``traffic_report`` counts all three.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from time import perf_counter
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np
from highway_env.road.road import LaneIndex, Road, RoadNetwork
from highway_env.utils import wrap_to_pi
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import Landmark, RoadObject
from threadpoolctl import ThreadpoolController

from olne_bench.games.reference_game import FAR_AWAY, ReferenceGame, Situation

PLAN_STEP = 0.4  # [s] between plans, and the step of the games
STEPS = 10  # steps per plan
HORIZON = STEPS * PLAN_STEP  # [s]
MAX_PLAYERS = 5  # in one game
NEIGHBOURHOOD = 50.0  # [m] around a vehicle in which others plan with it
NUM_OTHERS = 3  # predicted vehicles and obstacles that each player avoids besides the players
SIGHT = 80.0  # [m] up to which these are looked for
PURSUIT_TIME = 1.2  # [s] in which a start without a plan goes back to the lane
CURVE_ACCELERATION = 5.0  # [m/s^2] across, for which drivers slow down in curves
MAX_CURVATURE = 0.1  # [1/m]
MAX_SHIFTS = 3  # plan steps for which an old plan may serve


@dataclass(frozen=True)
class Temperament:
    """A driver's cost weights, in the units of ``games.reference_game.Units``.

    Attributes:
        proximity: distance from others.
        speed: the target speed.
        acceleration: comfort along.
        turning: comfort across.
        lane: keeping the middle of the target lane.
        haste: factor on the target speed.
    """

    proximity: float = 2.5
    speed: float = 1.0
    acceleration: float = 0.5
    turning: float = 0.5
    lane: float = 1.0
    haste: float = 1.0

    @property
    def weights(self) -> np.ndarray:
        """(5,) in the order of ``games.reference_game.WEIGHT_NAMES``."""
        return np.array([self.proximity, self.speed, self.acceleration, self.turning, self.lane])


#: Presets by name.
TEMPERAMENTS: dict[str, Temperament] = {
    "aggressive": Temperament(proximity=1.0, speed=2.0, acceleration=0.2, turning=0.3, haste=1.1),
    "normal": Temperament(),
    "cautious": Temperament(proximity=4.0, speed=0.7, acceleration=0.7, turning=0.8, haste=0.9),
}


def temperament(preset: str | Temperament) -> Temperament:
    """A preset by name; a temperament is returned as it is.

    Raises:
        ValueError: on an unknown name.
    """
    if isinstance(preset, Temperament):
        return preset
    if preset not in TEMPERAMENTS:
        raise ValueError(f"unknown temperament {preset!r}; known are: {', '.join(TEMPERAMENTS)}")
    return TEMPERAMENTS[preset]


@dataclass
class TrafficReport:
    """How the plans on one road came about.

    Attributes:
        solved: vehicle plans that are equilibria.
        shifted: times a vehicle went on with its previous plan.
        braked: times a vehicle fell back on the Intelligent Driver Model, for want of a plan or
            of one that keeps clear of the others.
        seconds: the latest solving times [s], by number of players.
    """

    solved: int = 0
    shifted: int = 0
    braked: int = 0
    seconds: dict[int, deque[float]] = field(default_factory=dict)


_REPORTS: WeakKeyDictionary[Road, TrafficReport] = WeakKeyDictionary()


def traffic_report(road: Road) -> TrafficReport:
    """The report of a road, such as ``env.unwrapped.road``."""
    return _REPORTS.setdefault(road, TrafficReport())


@dataclass(frozen=True)
class _VehiclePlan:
    """What one vehicle means to do.

    Attributes:
        states: (T, 4), the first is where the plan began.
        controls: (T-1, 2) steering [rad], acceleration [m/s^2].
        shifts: plan steps since it was solved.
    """

    states: np.ndarray
    controls: np.ndarray
    shifts: int = 0

    def shifted(self) -> "_VehiclePlan":
        """The same without its first step, coasting at the end."""
        last = self.states[-1].copy()
        last[:2] += PLAN_STEP * last[3] * np.array([np.cos(last[2]), np.sin(last[2])])
        return _VehiclePlan(
            np.vstack([self.states[1:], last]),
            np.vstack([self.controls[1:], np.zeros((1, 2))]),
            self.shifts + 1,
        )


class NashVehicle(IDMVehicle):
    """A vehicle that plays a Nash equilibrium with its kind around it.

    It takes the arguments of HighwayEnv's ``IDMVehicle``. To choose a temperament, use one of the
    subclasses, derive one with another ``TEMPERAMENT`` (a preset's name or a ``Temperament``), or
    call ``set_temperament`` on a vehicle.

    Attributes:
        temperament: its cost weights.

    Raises:
        ValueError: where ``TEMPERAMENT`` is the name of no preset.
    """

    TEMPERAMENT: ClassVar[str | Temperament] = "normal"

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.temperament = temperament(self.TEMPERAMENT)
        self._plan: _VehiclePlan | None = None
        self._age = PLAN_STEP  # [s] since the latest plan; the first is due at once

    def set_temperament(self, preset: str | Temperament) -> None:
        """Change the cost weights from the next plan on.

        Raises:
            ValueError: on an unknown name.
        """
        self.temperament = temperament(preset)

    def act(self, action: dict | str | None = None) -> None:
        """Drive the plan, and make a new one when it is due; actions are ignored as in IDM."""
        if self.crashed:
            return
        if self._is_due():
            _plan_together(self)
        if self._plan is None:
            super().act()
            return
        steering, acceleration = self._plan.controls[0]
        # Plans may end in reverse where that is the only way out; cars on these roads stop.
        acceleration = max(acceleration, -max(self.speed, 0.0) / PLAN_STEP)
        limit = self.MAX_STEERING_ANGLE
        Vehicle.act(
            self,
            {
                "steering": float(np.clip(steering, -limit, limit)),
                "acceleration": float(np.clip(acceleration, -self.ACC_MAX, self.ACC_MAX)),
            },
        )

    def step(self, dt: float) -> None:
        self._age += dt
        super().step(dt)

    def _is_due(self) -> bool:
        return self._age > PLAN_STEP - 1e-6

    def _choose_lane(self) -> None:
        self.follow_road()
        if self.enable_lane_change:
            self.change_lane_policy()

    def _adopt(self, plan: _VehiclePlan | None) -> None:
        self._plan, self._age = plan, 0.0

    def _state(self) -> np.ndarray:
        return np.array([*self.position, self.heading, self.speed])

    def _previous(self) -> _VehiclePlan | None:
        """The plan as it goes on from now."""
        return self._plan.shifted() if self._plan else None


class AggressiveNashVehicle(NashVehicle):
    """A hasty Nash vehicle that keeps short distances."""

    TEMPERAMENT = "aggressive"


class CautiousNashVehicle(NashVehicle):
    """A slow Nash vehicle that keeps long distances."""

    TEMPERAMENT = "cautious"


class MixedNashVehicle(NashVehicle):
    """A Nash vehicle of a temperament drawn from the road's random stream."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if self.road is not None:
            names = list(TEMPERAMENTS)
            self.set_temperament(names[int(self.road.np_random.integers(len(names)))])


def _plan_together(vehicle: NashVehicle) -> None:
    """Give the vehicle, and those near it whose plans are due as well, a plan each."""
    group = _group(vehicle)
    for member in group:
        member._choose_lane()
    starts = [member._previous() for member in group]
    situation = _situation(group, starts)
    pursuit = [
        _pursuit(*pair) for pair in zip(situation.initial_state, situation.references, strict=True)
    ]
    warm = [p if s is None else s.controls for s, p in zip(starts, pursuit, strict=True)]
    begin = perf_counter()
    # BLAS on several threads is a hundred times slower on matrices this small.
    with _blas().limit(limits=1, user_api="blas"):
        plan = _game().solve(situation, np.stack(warm, axis=1))
        if not plan.converged and any(start is not None for start in starts):
            plan = _game().solve(situation, np.stack(pursuit, axis=1))
    report = traffic_report(vehicle.road)
    times = report.seconds.setdefault(len(group), deque(maxlen=10_000))
    times.append(perf_counter() - begin)

    for index, (member, start) in enumerate(zip(group, starts, strict=True)):
        if plan.converged and _runs_into_something(plan.states, situation.others[index], index):
            report.braked += 1
            member._adopt(None)
        elif plan.converged:
            report.solved += 1
            member._adopt(_VehiclePlan(plan.states[:, index], plan.controls[:, index]))
        elif start is not None and start.shifts <= MAX_SHIFTS:
            report.shifted += 1
            member._adopt(start)
        else:
            report.braked += 1
            member._adopt(None)


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


def _group(vehicle: NashVehicle) -> list[NashVehicle]:
    """The vehicle and the nearest others that plan now, MAX_PLAYERS at most."""
    near = [
        (float(np.hypot(*(other.position - vehicle.position))), index, other)
        for index, other in enumerate(vehicle.road.vehicles)
        if isinstance(other, NashVehicle)
        and other is not vehicle
        and not other.crashed
        and other._is_due()
    ]
    nearest = sorted(entry for entry in near if entry[0] < NEIGHBOURHOOD)[: MAX_PLAYERS - 1]
    return [vehicle, *(other for _, _, other in nearest)]


def _situation(group: list[NashVehicle], starts: Sequence[_VehiclePlan | None]) -> Situation:
    predicted = [
        _predict(other)
        for other in [*group[0].road.vehicles, *group[0].road.objects]
        if not any(other is member for member in group) and not isinstance(other, Landmark)
        if np.hypot(*(other.position - group[0].position)) < SIGHT + NEIGHBOURHOOD
    ]
    return Situation(
        initial_state=np.stack([member._state() for member in group]),
        weights=np.stack([member.temperament.weights for member in group]),
        references=np.stack(
            [_references(member, start) for member, start in zip(group, starts, strict=True)]
        ),
        others=np.stack([_nearest(member, predicted) for member in group]),
    )


def _references(vehicle: NashVehicle, start: _VehiclePlan | None) -> np.ndarray:
    """(T-1, 4) points of the target lane and its successors where the vehicle will pass."""
    speeds = np.full(STEPS, vehicle.speed) if start is None else start.states[:-1, 3]
    distances = PLAN_STEP * np.cumsum(np.maximum(speeds, 0.0))
    points, limits = _along_lanes(
        vehicle.road.network,
        vehicle.target_lane_index,
        vehicle.route,
        vehicle.position,
        distances,
        lateral=0.0,
    )
    target = np.minimum(vehicle.target_speed * vehicle.temperament.haste, limits)
    target = np.minimum(target, _curve_speeds(points))
    return np.column_stack([points, target])


def _curve_speeds(points: np.ndarray) -> np.ndarray:
    """(T-1,) speeds [m/s] at which the curve through the points is comfortable."""
    step = np.hypot(*np.diff(points[:, :2], axis=0).T)
    turn = np.abs(np.diff(np.unwrap(points[:, 2])))
    # A vehicle that hardly moves sees no curve; lanes that do not touch make none either.
    curvature = np.clip(turn / np.maximum(step, 1.0), 1e-6, MAX_CURVATURE)
    speeds = np.sqrt(CURVE_ACCELERATION / curvature)
    return np.append(speeds, speeds[-1])


def _predict(other: RoadObject) -> np.ndarray:
    """(T-1, 2) positions at the next plan steps."""
    if isinstance(other, NashVehicle) and not other.crashed and other._plan is not None:
        passed = int(other._age / PLAN_STEP + 0.5)
        plan = other._plan.shifted() if passed else other._plan
        return plan.states[1:, :2]
    times = PLAN_STEP * np.arange(1, STEPS + 1)
    if not isinstance(other, Vehicle) or other.crashed or other.lane is None:
        return other.position + times[:, None] * other.velocity
    _, lateral = other.lane.local_coordinates(other.position)
    points, _ = _along_lanes(
        other.road.network,
        other.lane_index,
        getattr(other, "route", None),
        other.position,
        times * other.speed,
        lateral,
    )
    return points[:, :2]


def _nearest(vehicle: NashVehicle, predicted: list[np.ndarray]) -> np.ndarray:
    """(M, T-1, 2) of the predictions that begin nearest to the vehicle."""
    nearest = np.full((NUM_OTHERS, STEPS, 2), FAR_AWAY)
    distances = [float(np.hypot(*(path[0] - vehicle.position))) for path in predicted]
    for slot, index in enumerate(np.argsort(distances)[:NUM_OTHERS]):
        if distances[index] < SIGHT:
            nearest[slot] = predicted[index]
    return nearest


def _along_lanes(
    network: RoadNetwork,
    index: LaneIndex,
    route: list[LaneIndex] | None,
    position: np.ndarray,
    distances: np.ndarray,
    lateral: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Points (S, 3) px, py, direction at distances from a position along a lane and what follows.

    Also the speed limit (S,) [m/s] at each. The last lane is extended beyond its end.
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


def _pursuit(state: np.ndarray, references: np.ndarray) -> np.ndarray:
    """(T-1, 2) controls that lead to the references at constant speed: a start without a plan.

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


def __getattr__(name: str) -> Any:
    """HighwayEnv looks up ``other_vehicles_type`` here: say what there is instead."""
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    presets = sorted(c.__name__ for c in [NashVehicle, *NashVehicle.__subclasses__()])
    raise AttributeError(
        f"module {__name__!r} has no {name!r}; vehicles there are: {', '.join(presets)}"
    )

"""A drive of an ego among other cars, in HighwayEnv's simulator: 20 s, or an encounter of 8 s.

It begins as ``envs.drive.starts`` says. The others are players of the family's game with hidden
weights and target speeds, or HighwayEnv's own drivers. Each second, cars that are done leave and
others enter at the family's starts, but for an encounter. The same seed and the same controls of
the ego make the same drive, bit by bit.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from highway_env.road.road import Road as SimulatedRoad
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.drive.cars import (
    FRAMES,
    ROADS,
    STEP,
    Car,
    DriveRoad,
    proposed_cars,
)
from olne_bench.envs.drive.nash_traffic import REPLAN, NashTraffic, PlanCounts
from olne_bench.envs.drive.setting import NASH, STOCK, THROUGH, DriveSetting
from olne_bench.envs.drive.starts import ego_seen, first_cars, rng_of
from olne_bench.envs.roads.footprint import gap
from olne_bench.envs.roads.highway_roads import SIMULATION_FREQUENCY, make_road
from olne_bench.envs.roads.road_scenario import NOISE_SCALE
from olne_bench.envs.roads.simulated_roads import PlayersOnly
from olne_bench.envs.roads.stock_drivers import StockDriver, stock_car, stock_route
from olne_bench.games.model.lanes import StraightLane

_ENTRIES = 3  # proposals from which cars may enter at one time
_FREE = 8.0  # least gap [m] of a car that enters
#: Other cars that an ego looks at: the nearest ones.
NEAREST = 4


@dataclass
class DriveCounts:
    """What happened among the other cars."""

    plans: PlanCounts = field(default_factory=PlanCounts)  # of Nash traffic
    entered: int = 0
    left: int = 0
    collided: int = 0  # without the ego, and taken off the road


class DriveWorld:
    """One drive: its cars, the ego first, and HighwayEnv's environment ``road``.

    It is over once the ego has ``crashed``, at a ``collision_speed``. ``value`` is an encounter's
    value of information.
    """

    def __init__(
        self,
        setting: DriveSetting,
        seed: int,
        *,
        stock_ego: bool = False,
    ) -> None:
        """Draw the start of the drive that the seed identifies, or raise NoDriveError.

        HighwayEnv's own driver drives a ``stock_ego``.
        """
        self.setting, self._settings, self._seed = setting, ROADS[setting.road], seed
        self._stock_ego = stock_ego
        first = first_cars(setting, seed)
        self.value = first.value
        self._nash = NashTraffic(first.plan, ego_seen(setting))
        self.step, self.crashed = 0, False
        self.at_lane_end = False  # what the ego hit: the end of its lane, else a car
        self.collision_speed: float | None = None  # [m/s]
        self.counts = DriveCounts(plans=self._nash.counts)
        self.road: PlayersOnly = make_road(setting.road)
        self.road.road.np_random = np.random.RandomState(seed % 2**32)
        self.cars = list(first.cars)
        self._origin = self.cars[0].start[0]
        self._vehicles = {car.number: self._vehicle(car) for car in self.cars}
        self._next = len(self.cars)
        self._show()

    def states(self) -> np.ndarray:
        """(N, 4) states of the cars."""
        vehicles = [self._vehicles[car.number] for car in self.cars]
        return np.array([[*one.position, one.heading, one.speed] for one in vehicles])

    @property
    def moving(self) -> bool:
        """Whether the road goes on, along x."""
        return self._settings.moving

    @property
    def over(self) -> bool:
        """Whether the drive has ended."""
        return self.crashed or self.step >= self.setting.steps

    def advance(self, control: np.ndarray | None) -> None:
        """One step, with steering [rad] and acceleration [m/s^2]; None if a stock ego drives."""
        if (control is None) != self._stock_ego:
            raise ValueError("an ego has controls, unless HighwayEnv's driver drives it")
        if control is not None and not np.isfinite(control).all():
            raise ValueError(f"the ego's control must be finite, got {control}")
        before = self.states()
        self._choose_controls(control)
        for _ in range(FRAMES):
            self._frame()
        self.step += 1
        self.crashed = bool(self._vehicles[self.cars[0].number].crashed)
        if self.crashed:
            self.at_lane_end = any(end.crashed for end in self.road.road.objects)
            self.collision_speed = self._hit_speed(before)
        else:
            self._clear()
            if self.step % REPLAN == 0 and self.setting.scene == THROUGH:
                self._leave()
                self._enter()
        self._show()

    def _hit_speed(self, before: np.ndarray) -> float:
        """Speed [m/s] of a crashed ego relative to the nearest car, or to the end of its lane.

        It is that of the states (N, 4) before the step, as HighwayEnv brakes who has crashed.
        """
        ego, *others = self.states()
        if self.at_lane_end or not others:
            return float(before[0, 3])
        nearest = 1 + int(np.argmin(gap(ego, np.stack(others))))
        headings, speeds = before[[0, nearest], 2], before[[0, nearest], 3]
        velocities = speeds[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
        return float(np.linalg.norm(velocities[0] - velocities[1]))

    def _frame(self) -> None:
        """One frame of the simulator.

        At the intersection, its right of way makes HighwayEnv's own drivers wait. To look for
        conflicts takes half of the time of a drive, so it is left out where none of them drives.
        """
        road = self.road.road
        stock = [vehicle for vehicle in road.vehicles if isinstance(vehicle, IDMVehicle)]
        for vehicle in stock:
            vehicle.act()
        if stock:
            road.step(1 / SIMULATION_FREQUENCY)
        else:
            SimulatedRoad.step(road, 1 / SIMULATION_FREQUENCY)

    def ego_control(self, before: np.ndarray) -> np.ndarray:
        """Steering and mean acceleration (2,) of the last step, from the state (4,) before it."""
        vehicle = self._vehicles[0]
        return np.array([vehicle.action["steering"], (vehicle.speed - before[3]) / STEP])

    def _choose_controls(self, control: np.ndarray | None) -> None:
        states = self.states()
        if self.setting.traffic == NASH and self.step % REPLAN == 0:
            self._nash.plan(self.cars, states)
        for car, state in zip(self.cars, states, strict=True):
            chosen = self._nash.control(car, state) if self.setting.traffic == NASH else None
            if car.number == 0:
                chosen = control
            if chosen is not None:
                steering, acceleration = (float(value) for value in chosen)
                self._vehicles[car.number].act({"steering": steering, "acceleration": acceleration})

    def _vehicle(self, car: Car) -> Vehicle:
        road, (px, py, heading, speed) = self.road.road, car.start
        if self.setting.traffic == STOCK if car.number else self._stock_ego:
            route = stock_route(self.setting.road, car.lanes)
            return stock_car(road, car.start, StockDriver(car.target_speed), route)
        return Vehicle(road, [float(px), float(py)], float(heading), float(speed))

    def _show(self) -> None:
        """Tell the simulator who is on the road."""
        self.road.road.vehicles = [self._vehicles[car.number] for car in self.cars]

    def _clear(self) -> None:
        """Take others that have collided off the road."""
        crashed = {car.number for car in self.cars if self._vehicles[car.number].crashed}
        self.counts.collided += len(crashed)
        self._remove(crashed)

    def _leave(self) -> None:
        states, road = self.states(), self._settings
        px, py, heading, _ = states[0]
        gone = set()
        for car, state in zip(self.cars[1:], states[1:], strict=True):
            dx, dy = state[0] - px, state[1] - py
            ahead = dx * np.cos(heading) + dy * np.sin(heading)
            near = -road.behind <= ahead <= road.ahead
            if not near if road.moving else _left(car, state, road):
                gone.add(car.number)
        self.counts.left += len(gone)
        self._remove(gone)

    def _remove(self, numbers: set[int]) -> None:
        self.cars = [car for car in self.cars if car.number not in numbers]
        self._nash.drop(numbers)
        for number in numbers:
            del self._vehicles[number]

    def _enter(self) -> None:
        """Cars enter where proposals begin, as far as there is room."""
        for attempt in range(_ENTRIES):
            rng = rng_of(self.setting.road, self._seed, self.step, attempt)
            proposed = proposed_cars(self._settings, rng, self.setting.weights)
            shift = self._settings.shift * float(rng.choice((-1.0, 1.0)))
            for car in proposed[1:]:
                if len(self.cars) == self._settings.cars:
                    return
                self._enter_one(car, shift)

    def _enter_one(self, car: Car, shift: float) -> None:
        road, states = self._settings, self.states()
        if road.moving and len(car.lanes) == 1:
            start = car.start.copy()
            start[0] += states[0, 0] - self._origin + shift
            car = replace(car, start=start)
        around = gap(car.start[None], states)
        offset = car.start[0] - states[0, 0]
        if road.moving and not -road.behind < offset < road.ahead:
            return
        room = _FREE + float(np.abs(states[:, 3] - car.start[3]).max())  # more if speeds differ
        if around[0] < road.entry or around.min() < room:
            return
        car = replace(car, number=self._next)
        self._next += 1
        self.counts.entered += 1
        self.cars.append(car)
        self._vehicles[car.number] = self._vehicle(car)


def _left(car: Car, state: np.ndarray, road: DriveRoad) -> bool:
    """Whether a car is on the last lane of its route, and far from the middle of the road."""
    if np.hypot(state[0], state[1]) <= road.ahead:
        return False
    last = car.lanes[-1]
    assert isinstance(last, StraightLane)
    (x, y), (cos, sin) = last.start, last.direction
    beside = (state[1] - y) * cos - (state[0] - x) * sin
    ahead = (state[0] - x) * cos + (state[1] - y) * sin
    return bool(ahead > 0 and abs(beside) < Vehicle.LENGTH)


def seen(
    world: DriveWorld, sigma: float, rng_of: Callable[[Car], np.random.Generator]
) -> tuple[list[Car], np.ndarray]:
    """The ego and the nearest others, in order of their numbers, and samples (1 + M, 4) of them.

    The ego knows its own state; ``sigma`` is the noise on the others' positions [m].
    """
    samples = world.states()
    away = np.linalg.norm(samples[1:, :2] - samples[0, :2], axis=1)
    places = [0, *sorted(1 + np.argsort(away, kind="stable")[:NEAREST])]
    cars = [world.cars[place] for place in places]
    samples = samples[places]
    for sample, car in zip(samples[1:], cars[1:], strict=True):
        noise = rng_of(car).standard_normal(len(sample)) * np.array(NOISE_SCALE)
        sample += sigma * noise
    return cars, samples

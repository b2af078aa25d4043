"""A vehicle of HighwayEnv that has a temperament and follows a given plan."""

from dataclasses import dataclass
from functools import cached_property
from math import cos, hypot, sin
from typing import Any, ClassVar

import numpy as np
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from highway_env.vehicle.objects import RoadObject

PLAN_STEP = 0.4  # [s] between plans, and the step of the games
STEPS = 10  # steps per plan
#: Cosine of the angle between two cars that drive in one direction, at least.
ALIKE = 0.8
#: Braking [m/s^2] from which on a car brakes for the one ahead, whatever its plan; and the room [m]
#: that is then left.
_DUE, _LEFT = 2.5, 1.0


@dataclass(frozen=True)
class Temperament:
    """A driver's cost weights, in the units of ``games.solve.reference_game.Units``."""

    proximity: float = 2.5  # weight of proximity to others
    speed: float = 1.0  # weight of deviations from the target speed
    acceleration: float = 0.5  # weight of longitudinal comfort
    turning: float = 0.5  # weight of lateral comfort
    lane: float = 1.0  # weight of deviations from the centre of the target lane
    haste: float = 1.0  # factor on the target speed

    @property
    def weights(self) -> np.ndarray:
        """Weights (5,) in the order of ``games.solve.reference_game.WEIGHT_NAMES``."""
        return np.array([self.proximity, self.speed, self.acceleration, self.turning, self.lane])


#: Presets by name.
TEMPERAMENTS: dict[str, Temperament] = {
    "aggressive": Temperament(proximity=1.0, speed=2.0, acceleration=0.2, turning=0.3, haste=1.1),
    "normal": Temperament(),
    "cautious": Temperament(proximity=4.0, speed=0.7, acceleration=0.7, turning=0.8, haste=0.9),
}


def temperament(preset: str | Temperament) -> Temperament:
    """A preset by its name; a ``Temperament`` is returned unchanged."""
    if isinstance(preset, Temperament):
        return preset
    if preset not in TEMPERAMENTS:
        raise ValueError(f"unknown temperament {preset!r}; known are: {', '.join(TEMPERAMENTS)}")
    return TEMPERAMENTS[preset]


@dataclass(frozen=True)
class VehiclePlan:
    """Planned motion of one vehicle."""

    #: (T, 4) px [m], py [m], heading [rad], speed [m/s], from the start of the plan on.
    states: np.ndarray
    controls: np.ndarray  # (T-1, 2) steering [rad], acceleration [m/s^2]
    shifts: int = 0  # number of plan steps since it was solved

    @cached_property
    def rest(self) -> "VehiclePlan":
        """The plan without its first step, with a step of coasting at the end."""
        states, controls = np.empty_like(self.states), np.zeros_like(self.controls)
        states[:-1], controls[:-1] = self.states[1:], self.controls[1:]
        px, py, heading, speed = self.states[-1].tolist()
        ahead = PLAN_STEP * speed
        states[-1] = px + ahead * cos(heading), py + ahead * sin(heading), heading, speed
        return VehiclePlan(states, controls, self.shifts + 1)


class PlanningVehicle(IDMVehicle):
    """A vehicle with a temperament and a plan; without one, the Intelligent Driver Model drives."""

    TEMPERAMENT: ClassVar[str | Temperament] = "normal"

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.temperament = temperament(self.TEMPERAMENT)
        self.plan: VehiclePlan | None = None
        self.plan_age = PLAN_STEP  # the first plan is due at once
        self.ahead: Vehicle | None = None  # in its target lane, at the time of the plan
        self.room = np.inf  # [m] to the first contact of its last plan with a car that crosses

    def set_temperament(self, preset: str | Temperament) -> None:
        """Change the cost weights from the next plan on."""
        self.temperament = temperament(preset)

    def step(self, dt: float) -> None:
        self.plan_age += dt
        super().step(dt)

    def handle_collisions(self, other: RoadObject, dt: float = 0) -> None:
        """Handle collisions as HighwayEnv does, but skip distant objects early."""
        if not (self.check_collisions or other.check_collisions):
            return
        reach = (self.diagonal + other.diagonal) / 2 + self.speed * dt
        if abs(other.position[0] - self.position[0]) <= reach:
            super().handle_collisions(other, dt)

    def is_due(self) -> bool:
        """Whether it is time for a new plan."""
        return self.plan_age > PLAN_STEP - 1e-6

    def choose_lane(self) -> None:
        """Choose the target lane as the Intelligent Driver Model does."""
        self.follow_road()
        if self.enable_lane_change:
            self.change_lane_policy()
        self.ahead, _ = self.road.neighbour_vehicles(self, self.target_lane_index)

    def due_braking(self) -> float:
        """Acceleration [m/s^2] that keeps it off a slower car ahead; infinite while mild."""
        alike = 0.0 if self.ahead is None else cos(self.ahead.heading - self.heading)
        if self.ahead is None or alike < ALIKE:  # IDM and the plan see who crosses
            return np.inf
        closing = self.speed - self.ahead.speed * alike
        if closing <= 0:
            return np.inf
        (x, y), (px, py) = self.ahead.position, self.position
        room = hypot(x - px, y - py) - self.LENGTH - _LEFT
        needed = closing**2 / (2 * max(room, 0.1))
        return -needed if needed > _DUE else np.inf

    def adopt(self, plan: VehiclePlan | None, room: float = np.inf, age: float = 0.0) -> None:
        """Follow a plan from now on; None means the Intelligent Driver Model, within some room.

        The next one is due at the age PLAN_STEP.
        """
        self.plan, self.plan_age, self.room = plan, age, room

    def state(self) -> np.ndarray:
        """(4,) px [m], py [m], heading [rad], speed [m/s]."""
        return np.array([*self.position, self.heading, self.speed])

    def remaining_plan(self) -> VehiclePlan | None:
        """The rest of the plan from now on."""
        return self.plan.rest if self.plan else None

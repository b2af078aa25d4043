"""The plan of one Nash vehicle."""

from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

import numpy as np

PLAN_STEP = 0.4  # [s] between plans, and the step of the games
STEPS = 10  # steps per plan


@dataclass(frozen=True)
class VehiclePlan:
    """Planned motion of one vehicle.

    Attributes:
        states: (T, 4) px [m], py [m], heading [rad], speed [m/s], from the start of the plan on.
        controls: (T-1, 2) steering [rad], acceleration [m/s^2].
        shifts: number of plan steps since it was solved.
    """

    states: np.ndarray
    controls: np.ndarray
    shifts: int = 0

    @cached_property
    def rest(self) -> "VehiclePlan":
        """The plan without its first step, with a step of coasting at the end."""
        states, controls = np.empty_like(self.states), np.zeros_like(self.controls)
        states[:-1], controls[:-1] = self.states[1:], self.controls[1:]
        px, py, heading, speed = self.states[-1].tolist()
        ahead = PLAN_STEP * speed
        states[-1] = px + ahead * cos(heading), py + ahead * sin(heading), heading, speed
        return VehiclePlan(states, controls, self.shifts + 1)

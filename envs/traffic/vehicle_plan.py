"""What one Nash vehicle means to do."""

from dataclasses import dataclass

import numpy as np

PLAN_STEP = 0.4  # [s] between plans, and the step of the games
STEPS = 10  # steps per plan


@dataclass(frozen=True)
class VehiclePlan:
    """Planned motion of one vehicle.

    Attributes:
        states: (T, 4), the first is where the plan began.
        controls: (T-1, 2) steering [rad], acceleration [m/s^2].
        shifts: plan steps since it was solved.
    """

    states: np.ndarray
    controls: np.ndarray
    shifts: int = 0

    def shifted(self) -> "VehiclePlan":
        """The plan without its first step, with one of coasting at the end."""
        last = self.states[-1].copy()
        last[:2] += PLAN_STEP * last[3] * np.array([np.cos(last[2]), np.sin(last[2])])
        return VehiclePlan(
            np.vstack([self.states[1:], last]),
            np.vstack([self.controls[1:], np.zeros((1, 2))]),
            self.shifts + 1,
        )

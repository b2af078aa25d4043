"""A vehicle of HighwayEnv that follows a given plan."""

from typing import Any, ClassVar

import numpy as np
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.objects import RoadObject

from olne_bench.envs.traffic.temperaments import Temperament, temperament
from olne_bench.envs.traffic.vehicle_plan import PLAN_STEP, VehiclePlan


class PlanningVehicle(IDMVehicle):
    """A vehicle with a temperament and a plan.

    Attributes:
        temperament: its cost weights.
        plan: its plan, or None if it drives by the Intelligent Driver Model.
        plan_age: time since the plan was made [s].

    Raises:
        ValueError: if ``TEMPERAMENT`` names no preset.
    """

    TEMPERAMENT: ClassVar[str | Temperament] = "normal"

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.temperament = temperament(self.TEMPERAMENT)
        self.plan: VehiclePlan | None = None
        self.plan_age = PLAN_STEP  # the first plan is due at once

    def set_temperament(self, preset: str | Temperament) -> None:
        """Change the cost weights from the next plan on.

        Raises:
            ValueError: on an unknown name.
        """
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

    def adopt(self, plan: VehiclePlan | None) -> None:
        """Follow a plan from now on; None means the Intelligent Driver Model."""
        self.plan, self.plan_age = plan, 0.0

    def state(self) -> np.ndarray:
        """(4,) px [m], py [m], heading [rad], speed [m/s]."""
        return np.array([*self.position, self.heading, self.speed])

    def remaining_plan(self) -> VehiclePlan | None:
        """The rest of the plan from now on."""
        return self.plan.rest if self.plan else None

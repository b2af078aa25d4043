"""Vehicles for HighwayEnv's ``other_vehicles_type``."""

from typing import Any

import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.traffic.joint_planning import plan_together
from olne_bench.envs.traffic.planning_vehicle import PLAN_STEP, TEMPERAMENTS, PlanningVehicle


class NashVehicle(PlanningVehicle):
    """A vehicle that plays a Nash equilibrium with the Nash vehicles around it.

    It takes the arguments of HighwayEnv's ``IDMVehicle``. To choose a temperament, use one of the
    subclasses, derive one with another ``TEMPERAMENT`` (the name of a preset or a
    ``Temperament``), or call ``set_temperament`` on a vehicle.
    """

    def act(self, action: dict[str, Any] | str | None = None) -> None:
        """Follow the plan, and make a new one when it is due; actions are ignored, as in IDM."""
        if self.crashed:
            return
        if self.is_due():
            plan_together(self.road)
        # Plans, and HighwayEnv's driver model, may go in reverse if that is the only way out.
        # These cars stop instead.
        hardest_braking = -max(self.speed, 0.0) / PLAN_STEP
        if self.plan is None:
            super().act()
            acceleration = self.action["acceleration"]
            # IDM looks at its own lane, and would hit a car that crosses.
            if np.isfinite(self.room):
                stopping = self.speed**2 / (2 * max(self.room, 0.1))
                acceleration = min(acceleration, -min(stopping, self.ACC_MAX))
            self.action["acceleration"] = max(acceleration, hardest_braking)
            return
        steering, acceleration = self.plan.controls[0].tolist()
        acceleration = max(min(acceleration, self.due_braking()), hardest_braking)
        limit = self.MAX_STEERING_ANGLE
        Vehicle.act(
            self,
            {
                "steering": min(max(steering, -limit), limit),
                "acceleration": min(max(acceleration, -self.ACC_MAX), self.ACC_MAX),
            },
        )


class AggressiveNashVehicle(NashVehicle):
    """A hasty Nash vehicle that keeps short distances."""

    TEMPERAMENT = "aggressive"


class CautiousNashVehicle(NashVehicle):
    """A slow Nash vehicle that keeps long distances."""

    TEMPERAMENT = "cautious"


class MixedNashVehicle(NashVehicle):
    """A Nash vehicle whose temperament is drawn from the road's random stream."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if self.road is not None:
            names = list(TEMPERAMENTS)
            self.set_temperament(names[int(self.road.np_random.integers(len(names)))])

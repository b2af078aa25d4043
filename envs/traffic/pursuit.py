"""Initial controls of a plan if there is no previous one."""

import numpy as np
from highway_env.utils import wrap_to_pi
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.traffic.vehicle_plan import PLAN_STEP, STEPS

PURSUIT_TIME = 1.2  # [s] in which a vehicle without a plan returns to the lane


def pursuit_controls(state: np.ndarray, references: np.ndarray) -> np.ndarray:
    """Controls (T-1, 2) that pursue references (T-1, 4) at constant speed.

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

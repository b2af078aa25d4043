"""Check whether HighwayEnv plays a scenario's equilibrium exactly."""

import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.roads.highway_roads import MAX_ACCELERATION, MAX_STEERING, replay
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved import kept_draws
from olne_bench.envs.solved.equilibrium import certified_equilibrium

REPLAY_TOLERANCE = 1e-9  # [m], [rad], [m/s]
MARGIN = 0.25  # [m] on each side of a car, so that small deviations do not cause a collision


def rejection(scenario: Scenario) -> str | None:
    """Why a draw must not be used: no equilibrium, out of limits or collision.

    Returns:
        The reason, or None if the draw may be used.
    """
    if kept_draws.is_held(scenario.game, scenario.weights, scenario.initial_state):
        return None
    reason = _reason(scenario)
    if reason is not None:
        kept_draws.refuse(scenario.game, scenario.weights, scenario.initial_state)
    return reason


def _reason(scenario: Scenario) -> str | None:
    try:
        plan = certified_equilibrium(scenario)
    except NoEquilibriumError:
        return "no equilibrium"
    if (np.abs(plan.controls) > (MAX_STEERING, MAX_ACCELERATION)).any():
        return "out of limits"
    if np.abs(plan.states[..., 3]).max() > Vehicle.MAX_SPEED:
        return "out of limits"
    played = replay(scenario.name, plan.states[0], plan.controls, MARGIN)
    exact = np.abs(played - plan.states).max() < REPLAY_TOLERANCE
    return None if exact else "collision"

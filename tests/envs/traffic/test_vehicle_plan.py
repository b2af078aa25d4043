"""The rest of a plan after its first step."""

import numpy as np

from olne_bench.envs.traffic.planning_vehicle import PLAN_STEP, VehiclePlan
from olne_bench.games.model.dynamics import bicycle, rollout


def test_a_shifted_plan_is_the_rest_and_a_step_of_coasting() -> None:
    rng = np.random.default_rng(0)
    states, controls = rng.uniform(-1, 1, (5, 4)), rng.uniform(-1, 1, (4, 2))
    plan = VehiclePlan(states.copy(), controls.copy())
    once, twice = plan.rest, plan.rest.rest
    assert (plan.shifts, once.shifts, twice.shifts) == (0, 1, 2)
    np.testing.assert_array_equal(once.states[:-1], states[1:])
    np.testing.assert_array_equal(once.controls, [*controls[1:], [0, 0]])
    np.testing.assert_array_equal(twice.states[:-2], states[2:])
    np.testing.assert_array_equal(plan.states, states)
    coasted = rollout(bicycle(), states[None, -1], np.zeros((1, 1, 2)), PLAN_STEP)[-1, 0]
    np.testing.assert_allclose(once.states[-1], coasted, atol=1e-12)

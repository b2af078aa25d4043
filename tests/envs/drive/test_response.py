from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from olne_bench.envs.drive.cars import MOTION, STEP, Car, Mind
from olne_bench.envs.drive.planner import (
    CONSTRAINED,
    HORIZON,
    UNCONSTRAINED,
    planned_game,
    planned_response,
)
from olne_bench.envs.drive.response import LEAST_GAP, Room, responses
from olne_bench.envs.roads.footprint import gap
from olne_bench.games.model.costs import Stage
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.constrained_response import constrained_response
from tests.envs.drive.conftest import true_minds

Meeting = tuple[tuple[Car, ...], np.ndarray]
Around = tuple[list[Mind], np.ndarray, np.ndarray]


@pytest.fixture
def slow_ahead(meeting: Meeting) -> Around:
    """Minds of an ego and of one that drives slowly ahead of it in its lane; motion, controls."""
    cars, states = meeting
    states = states[:2].copy()
    heading = states[0, 2]
    states[0, 3] = 20.0
    states[1] = states[0]
    states[1, :2] += 15.0 * np.array([np.cos(heading), np.sin(heading)])
    states[1, 3] = 12.0
    controls = np.zeros((HORIZON - 1, 2, 2))
    return true_minds(cars)[:2], rollout(MOTION, states, controls, STEP), controls


def test_a_response_with_room_is_that_under_constraints(slow_ahead: Around) -> None:
    """IPOPT minimises the same cost under hard constraints."""
    minds, motion, controls = slow_ahead
    free = responses(minds[0], controls[None, :, 0], motion, controls, room=False)
    (plan,) = free.controls
    assert _nearest(plan, motion, controls) < LEAST_GAP
    joint = controls.copy()
    joint[:, 0] = plan
    found = planned_response(minds[0], (0, 1), motion, joint)
    hard = constrained_response(
        *(planned_game(minds), 0, motion, controls, plan, minds[0].weights),
    )
    assert found is not None and hard.converged
    assert found.kind == CONSTRAINED
    np.testing.assert_allclose(found.states[:, 0], hard.states, atol=0.05)
    assert _nearest(found.controls[:, 0], motion, controls) > LEAST_GAP - 0.01


def test_where_there_is_no_room_the_plan_says_so(slow_ahead: Around) -> None:
    minds, motion, controls = slow_ahead
    motion = motion.copy()
    motion[:, 1, :2] = motion[0, 0, :2]  # around the ego, at any time
    found = planned_response(minds[0], (0, 1), motion, controls)
    assert found is None or found.kind == UNCONSTRAINED


def test_room_costs_something_where_it_is_missing_alone() -> None:
    room = Room(1)
    assert room.watched == (1,)
    assert room.watching(()).running_cost(_stage(10.0)) == 0.0
    apart, near = (float(ca.DM(room.running_cost(_stage(x)))) for x in (12.0, 5.5))
    assert apart == 0
    assert near > 0
    assert float(ca.DM(replace(room, scale=2e4).final_cost(_stage(5.5)))) == pytest.approx(2 * near)


def _stage(ahead: float) -> Stage:
    states = (ca.DM([0.0, 0.0, 0.0, 10.0]), ca.DM([ahead, 0.0, 0.0, 10.0]))
    return Stage(0, states, None, MOTION, STEP)


def _nearest(plan: np.ndarray, motion: np.ndarray, controls: np.ndarray) -> float:
    joint = controls.copy()
    joint[:, 0] = plan
    own = rollout(MOTION, motion[0], joint, STEP)[:, :1]
    return float(gap(own, motion[:, 1:]).min())

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.drive.cars import Car
from olne_bench.envs.drive.ego_seen import AverageEgo, EgoSeen
from olne_bench.envs.drive.nash_traffic import REPLAN, nash_plan
from olne_bench.envs.drive.others import Others, rollouts
from tests.envs.drive.conftest import MERGE, true_minds

Meeting = tuple[tuple[Car, ...], np.ndarray]


def test_they_plan_what_nash_traffic_plans(meeting: Meeting) -> None:
    cars, states = meeting
    plan = Others(MERGE, cars[0], EgoSeen(), [true_minds(cars)]).first_planned(states)
    found = nash_plan(cars, states, [None] * len(cars))
    assert found is not None
    np.testing.assert_allclose(plan.states[0], found[0], atol=1e-6)
    np.testing.assert_allclose(plan.controls[0], found[1], atol=1e-6)


def test_if_the_ego_does_what_they_expect_their_plan_goes_on(meeting: Meeting) -> None:
    """For a second; then they look further ahead."""
    cars, states = meeting
    others = Others(MERGE, cars[0], EgoSeen(), [true_minds(cars)])
    plan = others.first_planned(states)
    motion, controls = others.played(plan, plan.controls[:, :, 0], REPLAN)
    np.testing.assert_allclose(motion[0, 0, : REPLAN + 1], plan.states[0, : REPLAN + 1], atol=1e-9)
    assert motion.shape == (1, 1, *plan.states.shape[1:])
    np.testing.assert_allclose(rollouts(states[None], controls[0]), motion[0], atol=1e-9)


def test_they_react_to_the_ego(meeting: Meeting) -> None:
    cars, states = meeting
    minds = [replace(mind, weights=np.array([0.85, 0.05, 0.05, 0.05])) for mind in true_minds(cars)]
    others = Others(MERGE, cars[0], AverageEgo(MERGE), [minds])
    plan = others.first_planned(states)
    own = np.stack([plan.controls[0, :, 0]] * 2)
    own[1, :, 1] -= 4.0
    motion, _ = others.played(plan, own, REPLAN)
    moved = np.abs(motion[0, 1, :, 1:, :2] - motion[0, 0, :, 1:, :2]).max(axis=(1, 2))
    assert (moved[: REPLAN + 1] == 0).all()
    assert moved[-1] > 0.1


def test_guesses_are_followed_as_if_each_was_alone(meeting: Meeting) -> None:
    cars, states = meeting
    truth = true_minds(cars)
    equal = (replace(mind, weights=np.full(4, 0.25)) for mind in truth[1:])
    other = [truth[0], *equal]
    together = Others(MERGE, cars[0], EgoSeen(), [truth, other])
    near = together.first_planned(states).repeated(2)
    plans = together.planned(states, near, ())
    own = np.stack([plans.controls[0, :, 0], plans.controls[1, :, 0]])
    motion, _ = together.played(plans, own, 2)
    for index, minds in enumerate((truth, other)):
        single = Others(MERGE, cars[0], EgoSeen(), [minds])
        alone, _ = single.played(plans.one(index), own, 2)
        np.testing.assert_allclose(motion[index], alone[0], atol=1e-6)


def test_who_goes_straight_on_reacts_to_nothing(meeting: Meeting) -> None:
    cars, states = meeting
    others = Others(MERGE, cars[0], EgoSeen(), [true_minds(cars)], straight_on=True)
    plan = others.first_planned(states)
    motion, controls = others.played(plan, np.ones((1, len(plan.controls[0]), 2)), REPLAN)
    assert (controls[0, 0, :, 1:] == 0).all()
    speeds = motion[0, 0, :, 1:, 3]
    np.testing.assert_allclose(speeds, np.broadcast_to(states[1:, 3], speeds.shape))
    assert pytest.approx(1.0) == controls[0, 0, 0, 0, 0]

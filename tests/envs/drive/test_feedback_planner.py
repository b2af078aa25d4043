import numpy as np
import pytest

from olne_bench.envs.drive.cars import Car, drive_game
from olne_bench.envs.drive.feedback_planner import FeedbackPlanner
from olne_bench.envs.drive.planner import CONSTRAINED, HORIZON
from olne_bench.envs.drive.response import LEAST_GAP
from olne_bench.envs.roads.footprint import gap
from olne_bench.games.solve.feedback import FeedbackEquilibrium, solve_feedback
from tests.envs.drive.conftest import true_minds

Meeting = tuple[tuple[Car, ...], np.ndarray]


def strategies(minds, states) -> FeedbackEquilibrium:
    game = drive_game([mind.player for mind in minds], HORIZON)
    return solve_feedback(game, np.stack([mind.weights for mind in minds]), states)


def test_it_plans_the_feedback_equilibrium_where_that_keeps_the_distance(meeting: Meeting) -> None:
    cars, states = meeting
    minds = true_minds(cars)
    states = states + np.array([[-40.0, 0, 0, 0], [0, 0, 0, 0], [60, 0, 0, 0]])
    found = strategies(minds, states)
    assert gap(found.states[:, :1], found.states[:, 1:]).min() > LEAST_GAP
    plan = FeedbackPlanner().plan(minds, states)
    np.testing.assert_allclose(plan.states, found.states, atol=1e-5)


def test_it_keeps_the_distance_where_the_equilibrium_does_not(meeting: Meeting) -> None:
    cars, states = meeting
    plan = FeedbackPlanner().plan(true_minds(cars), states)
    assert plan.kind == CONSTRAINED
    assert gap(plan.states[1:, :1], plan.states[1:, 1:]).min() > LEAST_GAP - 1e-3


def test_its_next_plan_begins_with_the_former(meeting: Meeting) -> None:
    cars, states = meeting
    minds, planner = true_minds(cars), FeedbackPlanner()
    first = planner.plan(minds, states)
    again = planner.plan(minds, first.states[1])
    assert np.abs(again.states[:-1, 0, :2] - first.states[1:, 0, :2]).max() < 1.0


def test_where_there_is_none_it_plans_by_the_open_loop(
    meeting: Meeting, monkeypatch: pytest.MonkeyPatch
) -> None:
    cars, states = meeting
    never = strategies(true_minds(cars), states)
    object.__setattr__(never, "residual", np.inf)
    monkeypatch.setattr(
        "olne_bench.envs.drive.feedback_planner.solve_feedback", lambda *_, **__: never
    )
    plan = FeedbackPlanner().plan(true_minds(cars), states)
    assert plan.kind == CONSTRAINED
    assert plan.costates.any()

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.drive.cars import Car, EgoCost, drive_game
from olne_bench.envs.drive.ego_seen import AverageEgo
from olne_bench.envs.drive.nash_traffic import REPLAN
from olne_bench.envs.drive.others import Others
from olne_bench.envs.drive.planner import HORIZON
from olne_bench.envs.drive.responding import RespondingPlanner, different
from olne_bench.games.solve.best_response import grown_plans
from tests.envs.drive.conftest import MERGE, true_minds

Meeting = tuple[tuple[Car, ...], np.ndarray]
SEEN = AverageEgo(MERGE)


def test_its_plan_costs_no_more_than_to_drive_as_on_an_empty_road(meeting: Meeting) -> None:
    cars, states = meeting
    minds = true_minds(cars)
    plan = RespondingPlanner(MERGE, cars[0], SEEN).plan(minds, states)
    alone = grown_plans(drive_game([cars[0].player], HORIZON), states[:1], cars[0].weights[None])
    others = Others(MERGE, cars[0], SEEN, [minds])
    own = np.stack([plan.controls[:, 0], alone[:, 0]])
    motion, controls = others.played(others.first_planned(states), own, REPLAN)
    costs = EgoCost(cars[0]).of_plans(motion[0], controls[0, :, :, 0])
    assert costs[0] <= costs[1] + 1e-9
    np.testing.assert_allclose(motion[0, 0], plan.states, atol=1e-6)


@pytest.mark.parametrize("contingent", [False, True])
def test_guesses_that_are_right_change_nothing_that_costs(
    contingent: bool, meeting: Meeting
) -> None:
    """With guesses that agree, the cheapest plan is the one without them, or one that branches."""
    cars, states = meeting
    minds = true_minds(cars)
    alone = RespondingPlanner(MERGE, cars[0], SEEN).plan(minds, states)
    planner = RespondingPlanner(MERGE, cars[0], SEEN, contingent=contingent)
    guessed = planner.plan(minds, states, [minds] * 3)
    cost = EgoCost(cars[0])
    costs = [float(cost.of_plans(one.states, one.controls[:, 0])) for one in (alone, guessed)]
    if contingent:
        assert costs[1] >= costs[0] - 1e-9
    else:
        assert costs[1] == pytest.approx(costs[0], abs=1e-9)


def test_guesses_that_differ_are_weighed(meeting: Meeting) -> None:
    """The mean cost over guesses of the plan that is chosen is that of the best candidate."""
    cars, states = meeting
    minds = true_minds(cars)
    wild = [
        [minds[0], *(replace(one, weights=np.array(weights)) for one in minds[1:])]
        for weights in ((0.05, 0.85, 0.05, 0.05), (0.85, 0.05, 0.05, 0.05))
    ]
    plan = RespondingPlanner(MERGE, cars[0], SEEN).plan(minds, states, wild)
    assert np.isfinite(plan.states).all()
    assert plan.states.shape == (HORIZON, 3, 4)


def test_an_ego_without_others_plans_for_itself(meeting: Meeting) -> None:
    cars, states = meeting
    plan = RespondingPlanner(MERGE, cars[0], SEEN).plan(true_minds(cars)[:1], states[:1])
    assert plan.numbers == (0,)
    assert np.isfinite(plan.controls).all()


def test_a_response_that_many_starts_lead_to_is_made_to_keep_the_distance_once() -> None:
    plans = np.zeros((4, 20, 2))
    plans[1, 3] = 1e-5, 1e-4  # the same to within what a solver leaves
    plans[2, 5, 1] = 0.5
    plans[3] = plans[2]
    kept = different(plans)
    assert len(kept) == 2
    assert (kept[0] == plans[0]).all() and (kept[1] == plans[2]).all()
    assert different(plans[:0]) == []

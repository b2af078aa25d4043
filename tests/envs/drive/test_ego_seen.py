from dataclasses import replace

import numpy as np
import pytest

from olne_bench.envs.drive.cars import ROADS, Car
from olne_bench.envs.drive.ego_seen import AverageEgo, EgoSeen, LearntEgo
from olne_bench.envs.drive.nash_traffic import REPLAN, nash_plan
from olne_bench.envs.roads.road_scenario import with_target
from olne_bench.envs.roads.temperaments import TEMPERAMENTS

Meeting = tuple[tuple[Car, ...], np.ndarray]


def test_an_average_driver_has_equal_weights_and_the_middle_speed(meeting: Meeting) -> None:
    (ego, *_), states = meeting
    seen = AverageEgo(ROADS["merge"]).car(ego, states[0])
    np.testing.assert_array_equal(seen.weights, np.full(4, 0.25))
    assert seen.target_speed == pytest.approx(24.5)  # of 21 to 28 m/s
    assert EgoSeen().car(ego, states[0]) is ego


def test_an_ego_is_learnt_from_its_way(meeting: Meeting) -> None:
    """One that speeds up as an aggressive driver with a high target does is taken for one."""
    (ego, *others), states = meeting
    fast = ROADS["merge"].family.speeds[1]
    hurry = np.array(TEMPERAMENTS["aggressive"]) / sum(TEMPERAMENTS["aggressive"])
    true = replace(ego, player=with_target(ego.player, fast), weights=hurry)
    learnt = LearntEgo(ROADS["merge"])
    before = learnt.car(ego, states[0])
    cars = (before, *others)
    plan = nash_plan(cars, states, [None] * len(cars))
    assert plan is not None
    learnt.planned(before, list(others), *plan, REPLAN)
    hurried = nash_plan((true, *others), states, [None] * len(cars))
    assert hurried is not None
    after = learnt.car(ego, hurried[0][REPLAN, 0])
    assert after.target_speed > before.target_speed
    assert after.weights.sum() == pytest.approx(1.0)

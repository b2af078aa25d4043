"""Changes of scenarios: their dials, what they change, and what they leave alone."""

from typing import Any

import numpy as np
import pytest

from olne_bench.envs.changes import CHANGES, make_change
from olne_bench.envs.changes.change import Samples
from olne_bench.envs.recordings.recording import record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.games.solve.plan_costs import PlanCosts
from olne_bench.plugins import PluginError

TWO = {"of": "two_player", "options": {"weights": "dirichlet"}}
ROAD = {"of": "merge", "options": {"num_players": 2, "weights": "temperaments"}}
CROSSING = {"of": "random", "options": {"num_players": 2}}
#: Where each change of the motion applies, and a dial.
DRIVEN: dict[str, tuple[dict[str, Any], float]] = {
    "replanning": (TWO, 0.5),
    "feedback": (ROAD, 1.0),
    "responding": (ROAD, 1.0),
    "leading": (ROAD, 1.0),
    "alone": (TWO, 1.0),
    "entropic": (TWO, 0.01),
    "stock": (ROAD, 1.0),
    "hidden_cost": (TWO, 1.0),
    "target_speed": (TWO, 0.2),
    "goal": (TWO, 0.2),
    "lane_offset": (ROAD, 0.5),
    "vehicle_length": (ROAD, 0.5),
    "wheelbase": (ROAD, 0.2),
    "unseen_cars": (CROSSING, 1.0),
}
NOISE = {name: change for name, change in CHANGES.items() if name not in DRIVEN}


@pytest.mark.parametrize("name", DRIVEN)
def test_players_drive_otherwise_and_the_equilibrium_stays_known(name: str) -> None:
    options, dial = DRIVEN[name]
    scenario = get_scenario("changed", 1, change=name, dial=dial, **options)
    found = record(scenario)
    assert found.planned is not None and found.everybody is not None
    assert np.abs(found.states - found.planned).max() > 1e-4
    np.testing.assert_array_equal(found.states[0], found.planned[0])
    equilibrium = certified_equilibrium(scenario)
    np.testing.assert_allclose(found.root.states, equilibrium.states, atol=1e-8)
    np.testing.assert_array_equal(record(scenario).states, found.states)


@pytest.mark.parametrize("name", CHANGES)
def test_a_dial_of_zero_is_the_scenario_itself(name: str) -> None:
    scenario = get_scenario("changed", 3, of="random", change=name, dial=0)
    own = get_scenario("random", 3)
    assert scenario.departure is None and scenario.game == own.game
    np.testing.assert_array_equal(scenario.weights, own.weights)


@pytest.mark.parametrize("name", ["feedback", "responding", "alone", "target_speed"])
def test_a_smaller_dial_changes_less(name: str) -> None:
    options, dial = DRIVEN[name]
    away = []
    for part in (dial, dial / 10):
        found = record(get_scenario("changed", 1, change=name, dial=part, **options))
        away.append(np.abs(found.states - found.root.states).max())
    assert away[1] < away[0] / 2


def test_who_is_not_reported_is_no_player_of_the_told_game() -> None:
    scenario = get_scenario("changed", 0, change="unseen_cars", dial=1.0, **CROSSING)
    found = record(scenario)
    assert scenario.game.num_players == 2 and found.states.shape[1] == 2
    assert found.everybody is not None
    assert len(found.everybody) == 3


def test_lanes_move_to_one_side() -> None:
    scenario = get_scenario("changed", 1, change="lane_offset", dial=0.5, **ROAD)
    other = get_scenario("changed", 1, change="lane_offset", dial=-0.5, **ROAD)
    one, two = record(scenario), record(other)
    beside = one.states[-1, :, 1] - two.states[-1, :, 1]
    assert (np.abs(beside) > 0.3).all() and len(set(np.sign(beside))) == 1


def test_derivatives_of_plans_are_those_of_their_costs() -> None:
    scenario = get_scenario("random", 0, num_players=2)
    game, plan = scenario.game, np.full(scenario.game.control_shape, 0.1)
    costs = PlanCosts(game, scenario.weights, scenario.initial_state)
    here, step = costs.at(plan), 1e-6
    for player, t, control in ((0, 3, 1), (1, 0, 0)):
        moved = plan.copy()
        moved[t, player, control] += step
        place = player * plan[:, 0].size + t * plan.shape[2] + control
        there = costs.at(moved)
        slopes = (there.costs - here.costs) / step
        np.testing.assert_allclose(slopes, here.slopes[:, place], rtol=1e-3, atol=1e-4)
        size = plan[:, 0].size
        mine = np.concatenate([there.slopes[i, i * size : (i + 1) * size] for i in (0, 1)])
        own = np.concatenate([here.slopes[i, i * size : (i + 1) * size] for i in (0, 1)])
        column = here.own_curvatures[:, place]
        np.testing.assert_allclose((mine - own) / step, column, rtol=1e-3, atol=1e-3)


@pytest.fixture
def samples() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors, what is seen without them, and their deviations."""
    rng = np.random.default_rng(0)
    deviations = np.array([0.2, 0.2, 0.02, 0.1])
    errors = deviations * rng.standard_normal((4000, 3, 4))
    errors[5, 1] = np.nan
    return errors, np.cumsum(np.ones((4000, 3, 4)), axis=0), deviations


@pytest.mark.parametrize("name", NOISE)
def test_what_is_not_seen_stays_unseen(name: str, samples: tuple[np.ndarray, ...]) -> None:
    found = make_change(name, 0.4).disturb(Samples(*samples), np.random.default_rng(0))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(samples[0]))
    assert not np.array_equal(found, samples[0], equal_nan=True)


def test_noise_has_the_moments_that_its_dial_says(samples: tuple[np.ndarray, ...]) -> None:
    errors, _, deviations = samples

    def disturbed(name: str, dial: float) -> np.ndarray:
        found = make_change(name, dial).disturb(Samples(*samples), np.random.default_rng(1))
        return found[10:] / deviations

    assert np.std(disturbed("noise_level", 1.0)) == pytest.approx(2.0, rel=0.03)
    lagged = disturbed("lagged_noise", 0.8)
    assert np.std(lagged) == pytest.approx(1.0, rel=0.05)
    assert np.mean(lagged[1:] * lagged[:-1]) == pytest.approx(0.8, abs=0.05)
    student = disturbed("student_noise", 0.2)
    assert np.std(student) == pytest.approx(1.0, rel=0.05)
    assert np.mean(student**4) > 5
    far = np.abs(disturbed("outliers", 0.1)).max(axis=2) > 6
    assert far.mean() == pytest.approx(0.1, rel=0.25)
    bias = disturbed("bias", 2.0).mean(axis=0)
    np.testing.assert_allclose(np.abs(bias), 2.0, atol=0.1)
    late = disturbed("clock_offset", 0.5) * deviations - errors[10:]
    np.testing.assert_allclose(late[:, 1], 0.5, atol=1e-9)
    np.testing.assert_array_equal(late[:, 0], 0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"change": "teleport"}, "there is no change 'teleport'; known are: replanning"),
        ({"change": "alone", "dial": 2}, "the dial of 'alone' must be from 0 to 1, got 2"),
        ({"change": "replanning", "dial": -1}, "from 0 to 10 s, got -1"),
        ({"change": "alone", "dial": float("nan")}, "must be from 0 to 1, got nan"),
        ({"change": "unseen_cars", "dial": 1.5}, "a whole number, got 1.5"),
        ({"of": "changed"}, "a built-in scenario other than this, got 'changed'"),
        ({"of": "highway", "options": {"speed": 3}}, "has no option 'speed'"),
    ],
)
def test_bad_options_are_refused_in_a_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(PluginError) as told:
        get_scenario("changed", 0, **options)
    assert message in str(told.value) and "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("stock", TWO, "stock drivers need a road of HighwayEnv, 'two_player' has none"),
        ("goal", ROAD, "'goal' does not apply: no player has a FinalGoal"),
        ("wheelbase", TWO, "'wheelbase' does not apply: 'unicycle' has no wheels"),
    ],
)
def test_a_change_that_does_not_apply_says_so(
    name: str, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        record(get_scenario("changed", 0, change=name, dial=0.5, **options))

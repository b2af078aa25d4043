"""Scenarios and observations are those of a study."""

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.bench.judge.trials import case_of
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import expand
from olne_bench.envs.scenarios.two_player import TwoPlayer
from olne_bench.envs.sensors.drop import Drop
from olne_bench.envs.sensors.partial import Partial


@pytest.mark.parametrize("name", ["two_player", "merge"])
@pytest.mark.parametrize("sensor", ["full", "partial"])
def test_an_observation_is_that_of_a_trial(name, sensor):
    (trial,) = (
        trial
        for trial in expand(load_suite("quick"))
        if trial.labels | {"scenario": name, "sensor": sensor, "sigma": 0.05, "seed": 3}
        == trial.labels
        and trial.estimator.name == "uniform"
    )
    case = case_of(trial)
    scenario = ob.scenario(name, seed=3, **trial.scenario.options)
    problem, seen = ob.observe(scenario, sensor, 0.05, seed=3)
    np.testing.assert_array_equal(seen.y, case.observations[0].y)
    np.testing.assert_array_equal(seen.extra, case.observations[0].extra)
    assert vars(problem) == vars(case.problem)


def test_a_draw_is_that_of_a_trial_and_brings_the_noise_scales_of_its_road():
    """The suite's draws come solved, so this takes no minutes."""
    trial = next(
        trial
        for trial in expand(load_suite("roads"), seeds=2)
        if trial.labels | {"scenario": "merge", "sensor": "partial", "seed": 1} == trial.labels
        and trial.sigma > 0
    )
    scenario = ob.scenario("merge", seed=1, salt="roads", **trial.scenario.options)
    problem, seen = ob.observe(scenario, "partial", trial.sigma)
    case = case_of(trial)
    np.testing.assert_array_equal(seen.y, case.observations[0].y)
    assert problem.noise_scale == case.problem.noise_scale == scenario.noise_scale[:3]
    assert "draw 1 of suite 'roads'" in repr(scenario)


def test_sensors_are_names_objects_views_or_stacks():
    scenario = ob.scenario("two_player")
    y = ob.observe(scenario, "partial", 0.1)[1].y
    for same in (Partial(), ob.views.ComponentView("partial", ("px", "py", "heading"))):
        np.testing.assert_array_equal(ob.observe(scenario, same, 0.1)[1].y, y)
    gappy = ob.observe(scenario, ("partial", Drop(0.5)), 0.1)[1].y
    assert 0 < np.isnan(gappy).sum() < gappy.size
    np.testing.assert_array_equal(gappy[~np.isnan(gappy)], y[~np.isnan(gappy)])


def test_a_scenario_of_your_own_is_observed_as_well():
    own = TwoPlayer().draw()
    _, seen = ob.observe(own, "full", 0.1)
    assert seen.y.shape == own.game.state_shape
    with pytest.raises(ValueError, match=r"unknown scenario 'two_playr'; .*nearest: two_player"):
        ob.observe("two_playr")
    with pytest.raises(TypeError, match=r"a scenario is a name or a Scenario, got 3"):
        ob.observe(3)
    with pytest.raises(TypeError, match=r"sigma is one number of at least 0, got '0.1'"):
        ob.observe("two_player", sigma="0.1")
    with pytest.raises(TypeError, match=r"a sensor is a name .correlated, drop, full.*got 3"):
        ob.observe("two_player", sensor=3)


def test_a_problem_of_a_game_needs_noise_scales():
    scenario = ob.scenario("two_player")
    with pytest.raises(ValueError, match=r"noise_scale must say how large the noise on px, py"):
        ob.problem(scenario.game, "full", 0.1)
    with pytest.raises(TypeError, match=r"game must be a Game or a Scenario, got 'merge'"):
        ob.problem("merge", "full", 0.1)
    told = ob.problem(scenario.game, "full", 0.1, noise_scale=(1, 1, 0.5, 2))
    assert told.noise_scale == (1, 1, 0.5, 2)
    assert vars(ob.problem(scenario, "full", 0.1)) == vars(ob.observe(scenario, "full", 0.1)[0])


def test_a_problem_names_what_it_is_not():
    scenario = ob.scenario("two_player")
    with pytest.raises(TypeError, match=r"view must be a View, such as FullView.., got 'full'"):
        ob.Problem(scenario.game, "full", 0.1)
    with pytest.raises(TypeError, match=r"game must be a Game, got Scenario"):
        ob.Problem(scenario, ob.views.FullView(), 0.1)


def test_things_say_what_they_are():
    scenario = ob.scenario("two_player")
    problem, seen = ob.observe(scenario, "partial", 0.1)
    for thing, said in (
        (scenario, "Scenario('two_player': Game(2 players, 25 states of 0.25 s; unicycle; "),
        (problem, "seen through 'partial': px, py, heading; noise 0.1 times 1, 1, 1)"),
        (seen, "25 x 2 x 3 samples (time, player, component), 0 of them missing; noise 0.1"),
    ):
        assert said in repr(thing)
        assert "\n" not in repr(thing)


def test_tables_have_a_line_on_everything():
    for table in (ob.scenarios(), ob.sensors(), ob.estimators()):
        assert table["description"].str.len().min() > 10
        assert table.index.is_unique
    assert "num_players" in ob.scenarios().loc["merge", "parameters"]
    assert "weights" in ob.scenarios().loc["two_player", "parameters"]  # inherited

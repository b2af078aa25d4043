"""Comparisons in this process have the rows of a study, and say what they are not."""

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.estimators.map import Map

SCORES = ["cosine_error", "position_error", "held_out_error", "covers_truth", "cosine_limit"]


class Crashes:
    name = "crashes"

    def estimate(self, problem, observation, *, rng, budget):
        raise RuntimeError("out of luck")


class Silly:
    name = "silly"

    def estimate(self, problem, observation, *, rng, budget):
        return ob.Estimate(-np.ones((2, 4)))


class Declines(Silly):
    name = "declines"

    def supports(self, problem):
        return "only on Mondays"


class Searches:
    name = "searches"
    found: list = []  # noqa: RUF012

    def estimate(self, problem, observation, *, rng, budget):
        assert type(observation) is ob.Observation
        assert not observation.y.flags.writeable
        self.found.append(sorted(vars(problem)))
        return ob.Estimate(np.ones((2, 4)))


@pytest.fixture(scope="module")
def result():
    estimators = ["map", Map(alpha=2.0), Crashes(), Silly, Declines, Searches()]
    return ob.compare("two_player", estimators, sigma=[0.05, 0.0], seeds=2)


def test_failures_are_rows(result):
    statuses = result.frame.groupby("estimator")["status"].unique().map(list).to_dict()
    assert statuses == {
        "map": ["ok"],
        "map(alpha=2.0)": ["ok"],
        "crashes": ["crash"],
        "silly": ["invalid"],
        "declines": ["skipped"],
        "searches": ["ok"],
    }
    crash = result.frame.query("estimator == 'crashes'").iloc[0]
    assert "RuntimeError: out of luck" in crash["message"]
    assert np.isnan(crash["position_error"])


def test_without_noise_one_trial_stands_for_all(result):
    counts = result.trials.groupby("sigma")["count"].agg(["size", "sum"])
    assert counts.loc[0.0].tolist() == [6, 12]
    assert counts.loc[0.05].tolist() == [12, 12]


def test_a_comparison_says_that_nothing_isolates_estimators(result):
    assert "nothing isolates these estimators" in repr(result)
    assert "6 failed" in repr(result)
    board = result.leaderboard.set_index("estimator")
    assert board.loc["crashes", "position_error_median"] == np.inf
    figure = result.plot()
    assert "nothing isolates" in figure.get_suptitle()
    with pytest.raises(ValueError, match="plot needs one scenario of two_player, got 'merge'"):
        result.plot("merge")


def test_an_estimator_is_shown_nothing_but_problem_and_observation(result):
    fields = ["game", "goes_on", "noise_covariance", "noise_scale", "prior", "sigma"]
    fields += ["sigma_spread", "view", "weight_floor"]
    assert Searches.found == [fields] * len(result.frame.query("estimator == 'searches'"))


def test_seeds_of_a_drawn_scenario_are_noise():
    drawn = ob.scenario("two_player", seed=3, weights="dirichlet")
    found = ob.compare(drawn, {"a": "uniform", "b": Map()}, sigma=0.1, seeds=2, sensor=["full"])
    errors = found.frame.pivot_table(values="cosine_error", index="seed", columns="estimator")
    assert errors["a"].nunique() == 1  # one truth
    assert errors["b"].nunique() == 2  # two noises
    assert set(found.frame["scenario"]) == {"two_player(weights=dirichlet)"}
    plain = ob.Scenario("mine", drawn.game, drawn.weights, drawn.initial_state, drawn.limits)
    own = ob.compare(plain, ["uniform"], sigma=0.1)
    assert own.frame["cosine_error"].tolist() == [errors.loc[0, "a"]]


@pytest.mark.parametrize(
    ("arguments", "options", "expected"),
    [
        (["map"], {"seeds": 10**6}, "this is 1000000 trials .*most_trials=1000000"),
        (["map", Map()], {}, "two estimators are called 'map'; give a mapping"),
        ([], {}, "estimators must name at least one"),
        (["mapp"], {}, "unknown estimator 'mapp'; .*nearest: map"),
        ([3], {}, "an estimator is a name .*got 3"),
        (["map"], {"sigma": -1}, "sigma must hold finite numbers of at least 0, got -1"),
        (["map"], {"sigma": []}, "sigma must hold at least one"),
        (["map"], {"seeds": 0}, "seeds must be an integer of 1 to 1000000, got 0"),
    ],
)
def test_wrong_use_is_one_line(arguments, options, expected):
    with pytest.raises((ValueError, TypeError), match=expected) as caught:
        ob.compare("two_player", arguments, **options)
    assert "\n" not in str(caught.value)

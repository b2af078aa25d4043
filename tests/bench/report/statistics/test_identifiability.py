import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.formulas import cosine_error
from olne_bench.bench.report.statistics.identifiability import (
    REFERENCE_SIGMA,
    bound_ratios,
    identifiability_table,
    identifiable_errors,
)
from olne_bench.envs.scenarios import get_scenario


def trials(scenario: str, weights: np.ndarray, **changes: object) -> pd.DataFrame:
    """One trial per estimate (S, N, K)."""
    truth = get_scenario(scenario).weights
    rows = [
        {
            "scenario": scenario,
            "sensor": "full",
            "estimator": "e",
            "sigma": REFERENCE_SIGMA,
            "seed": seed,
            "status": "ok",
            "cosine_error": cosine_error(truth, estimate),
            "count": 1,
            "weights": estimate.tolist(),
        }
        | changes
        for seed, estimate in enumerate(weights)
    ]
    return pd.DataFrame(rows)


def test_all_is_identified_where_all_shows(usual) -> None:
    truth = get_scenario("two_player").weights
    estimates = np.random.default_rng(0).dirichlet(np.ones(4), size=(5, 2))
    rows = trials("two_player", estimates)
    table = identifiability_table(rows, usual)
    assert len(table) == truth.size
    assert table["identified"].all()
    np.testing.assert_allclose(identifiable_errors(rows, usual), rows["cosine_error"], rtol=1e-9)


def test_several_trajectories_tell_more_than_one(usual) -> None:
    """Bounds fall by about the square root of their number, as all show the same players."""
    truth = get_scenario("two_player").weights
    one, four = (
        trials("two_player", truth[None] + [[0.1, -0.1, 0, 0]]).assign(scenario=label)
        for label in ("two_player", "two_player(trajectories=4)")
    )
    less, more = (identifiability_table(rows, usual)["bound"].to_numpy() for rows in (one, four))
    assert (more < less).all()
    assert 1.2 < np.median(less / more) < 5
    ratios = [bound_ratios(rows, usual)["ratio"].to_numpy() for rows in (one, four)]
    np.testing.assert_allclose(ratios[1] * more, ratios[0] * less)


def test_the_yaw_weight_of_a_car_that_never_steers_is_forgiven(usual) -> None:
    scenario = get_scenario("highway_overtaking")
    wrong = scenario.weights.copy()
    wrong[2, 3] = 0.0
    rows = trials("highway_overtaking", wrong[None] / wrong.sum(axis=1, keepdims=True))
    table = identifiability_table(rows, usual)
    yaw = table[table["weight"] == "yaw_rate"].set_index("player")["identified"]
    assert yaw.to_dict() == {1: True, 2: False, 3: False, 4: False, 5: True}
    assert rows["cosine_error"][0] > 0.03
    assert identifiable_errors(rows, usual)[0] < 0.1 * rows["cosine_error"][0]


def test_an_efficient_estimator_is_at_the_bound(usual) -> None:
    truth = get_scenario("two_player").weights
    table = identifiability_table(trials("two_player", truth[None]), usual)
    bound = table["bound"].to_numpy()
    drawn = np.random.default_rng(0).standard_normal((2000, *truth.shape))
    rows = trials("two_player", truth + bound.reshape(truth.shape) * drawn)
    np.testing.assert_allclose(bound_ratios(rows, usual)["ratio"], 1, rtol=0.1)


def test_errors_are_compared_at_their_own_noise_level(usual) -> None:
    truth = get_scenario("two_player").weights
    wrong = trials("two_player", truth[None] + 0.01 * np.array([1, -1, 1, -1]))
    half = wrong.assign(sigma=REFERENCE_SIGMA / 2)
    np.testing.assert_allclose(
        bound_ratios(half, usual)["ratio"], 2 * bound_ratios(wrong, usual)["ratio"]
    )


def test_a_failure_makes_ratios_infinite(usual) -> None:
    rows = trials("two_player", get_scenario("two_player").weights[None].repeat(2, axis=0))
    rows.loc[1, ["status", "cosine_error", "weights"]] = ["crash", np.nan, None]
    assert np.isinf(bound_ratios(rows, usual)["ratio"]).all()
    assert identifiable_errors(rows, usual).tolist() == [0, np.inf]


def test_what_is_not_known_here_is_left_out(usual) -> None:
    rows = trials("two_player", get_scenario("two_player").weights[None]).assign(scenario="gone")
    assert identifiability_table(rows, usual).empty
    assert bound_ratios(rows, usual).empty
    assert np.isnan(identifiable_errors(rows, usual)).all()


@pytest.mark.parametrize("sensor", ["full", "partial"])
def test_seeing_less_identifies_less(usual, sensor: str) -> None:
    truth = get_scenario("two_player").weights
    full, other = (
        identifiability_table(trials("two_player", truth[None], sensor=v), usual)
        for v in ("full", sensor)
    )
    assert len(full) == len(other) == truth.size
    assert (other["bound"] >= full["bound"] * (1 - 1e-9)).all()
    assert (other["left"] >= full["left"] * (1 - 1e-9)).all()


def test_parameters_have_bounds_and_ratios(usual) -> None:
    rows = trials("unknown_goals", get_scenario("unknown_goals").weights[None].repeat(2, axis=0))
    rows = rows.assign(seed=0)  # of a family, the first draw stands for the truth
    table = identifiability_table(rows, usual)
    goals = table[table["weight"].str.startswith("goal")]
    assert goals["weight"].tolist() == ["goal x [m]", "goal y [m]"] * 2
    assert goals["identified"].all()
    truth, bound = (goals[name].to_numpy().reshape(2, 2) for name in ("truth", "bound"))
    found = [(truth + sign * 3 * bound).tolist() for sign in (1, -1)]
    ratios = bound_ratios(rows.assign(unknowns=found), usual)
    assert len(ratios) == len(table)
    of_goals = ratios[ratios["weight"].str.startswith("goal")]
    np.testing.assert_allclose(of_goals["ratio"], 3, rtol=1e-9)
    lost = bound_ratios(rows.assign(unknowns=[found[0], None]), usual)
    assert np.isinf(lost.loc[lost["weight"].str.startswith("goal"), "ratio"]).all()
    former = bound_ratios(rows, usual)  # rows of a version that did not keep them
    assert not former["weight"].str.startswith("goal").any()


def test_draws_without_an_equilibrium_are_passed_over(usual) -> None:
    rows = trials("unknown_goals", np.full((2, 2, 4), 0.25))  # a family
    second = identifiable_errors(rows[rows["seed"] == 1], usual)
    assert np.isfinite(second).all()
    rows.loc[rows["seed"] == 0, ["status", "weights"]] = ["skipped", None]
    found = identifiable_errors(rows, usual)
    np.testing.assert_array_equal(found[1:], second)
    assert np.isnan(found[0])


def test_where_everybody_declines_there_is_no_ratio(usual) -> None:
    rows = trials("unknown_goals", np.full((2, 2, 4), 0.25), status="skipped")
    assert bound_ratios(rows, usual).empty

from itertools import product

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, false_discovery_control

from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.statistics.estimator_comparison import (
    compare_estimators,
    holm,
    leaders,
    permutation_p,
    ranks,
)
from olne_bench.bench.report.study import Study

FIXED = Study(scenarios={"two_player": ScenarioEntry(name="two_player", label="two_player")})


def compare(trials: pd.DataFrame) -> pd.DataFrame:
    return compare_estimators(trials, FIXED)


def study(errors: dict[str, np.ndarray], scenario: str = "two_player") -> pd.DataFrame:
    """Trials of estimators with these errors (levels, seeds); an infinite one is a failure."""
    rows = []
    for name, table in errors.items():
        for (level, seed), error in np.ndenumerate(table):
            fine = np.isfinite(error)
            rows.append(
                {
                    "scenario": scenario,
                    "sensor": "full",
                    "sigma": 0.01 * (level + 1),
                    "seed": seed,
                    "estimator": name,
                    "status": "ok" if fine else "crash",
                    "cosine_error": error if fine else np.nan,
                    "position_error": error if fine else np.nan,
                    "count": 1,
                }
            )
    return pd.DataFrame(rows)


def only(table: pd.DataFrame) -> pd.Series:
    rows = table[table["error"] == "cosine_error"]
    assert len(rows) == 1
    return rows.iloc[0]


def test_failures_lose_and_ties_count_half() -> None:
    a = np.array([[1.0, np.inf, np.inf, 1.0]])
    b = np.array([[2.0, 5.0, np.inf, 1.0]])
    row = only(compare(study({"a": a, "b": b})))
    assert (row["pairs"], row["wins"]) == (4, 0.5)
    assert row["p"] == 1.0


@pytest.mark.parametrize(("excess", "wins"), [(1e-9, 0.5), (9e-4, 0.5), (1.2e-3, 0.0)])
def test_errors_within_a_thousandth_are_a_tie(excess: float, wins: float) -> None:
    best = np.random.default_rng(0).uniform(size=(3, 10))
    row = only(compare(study({"a": best * (1 + excess), "b": best})))
    assert row["wins"] == wins
    assert (row["p"] < 1e-3) == (wins == 0)


@given(scale=st.floats(1e-6, 1e6))
def test_only_the_order_of_errors_counts(scale: float) -> None:
    rng = np.random.default_rng(0)
    a, b = rng.uniform(size=(2, 3, 10))
    plain = only(compare(study({"a": a, "b": b})))
    scaled = only(compare(study({"a": scale * a, "b": scale * b})))
    assert plain[["wins", "wins_low", "wins_high", "p"]].equals(
        scaled[["wins", "wins_low", "wins_high", "p"]]
    )
    turned = only(compare(study({"a": b, "b": a})))
    assert turned["wins"] == pytest.approx(1 - plain["wins"])
    assert turned["p"] == plain["p"]


@given(st.lists(st.integers(-7, 7), min_size=1, max_size=9))
def test_permutations_of_units_agree_with_all_of_them(advantages: list[int]) -> None:
    sums = [np.dot(signs, advantages) for signs in product((1, -1), repeat=len(advantages))]
    exact = np.mean(np.abs(sums) >= abs(sum(advantages)))
    assert permutation_p(np.array(advantages)) == pytest.approx(exact, rel=1e-9)


def test_there_is_no_floor_that_many_comparisons_cannot_pass() -> None:
    assert permutation_p(np.ones(100, int)) == pytest.approx(2.0**-99)
    assert permutation_p(np.array([2] * 50 + [3] * 50)) == pytest.approx(2.0**-99)
    large = np.random.default_rng(0).integers(1, 500, size=2000)
    assert 0 < permutation_p(large) < 1e-12


@given(wins=st.integers(0, 60))
def test_without_clusters_it_is_the_sign_test(wins: int) -> None:
    advantages = np.repeat([1, -1], [wins, 60 - wins])
    exact = binomtest(wins, 60).pvalue
    assert permutation_p(advantages) == pytest.approx(exact, rel=1e-9)


def test_a_family_is_compared_draw_by_draw() -> None:
    """Six levels of five draws are five independent units, not thirty."""
    a, b = np.zeros((6, 5)), np.ones((6, 5))
    fixed = only(compare(study({"a": a, "b": b})))
    family = only(compare(study({"a": a, "b": b}, "random(num_players=3)")))
    assert fixed["p"] < 0.001
    assert family["p"] == pytest.approx(2 / 2**5)
    assert family["wins_low"] < fixed["wins_low"]


def test_no_difference_is_rarely_significant() -> None:
    rng = np.random.default_rng(1)
    p = [permutation_p(rng.choice([-1, 1], size=50)) for _ in range(400)]
    assert np.mean(np.array(p) < 0.05) < 0.08


def test_rows_that_stand_for_many_take_no_part() -> None:
    trials = study({"a": np.zeros((2, 4)), "b": np.ones((2, 4))})
    trials.loc[trials["sigma"] == 0.01, "count"] = 40
    assert only(compare(trials))["pairs"] == 4


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm(p: list[float]) -> None:
    adjusted = holm(np.array(p))
    order = np.argsort(p)
    assert (np.diff(adjusted[order]) >= 0).all()
    assert adjusted[order[0]] == pytest.approx(min(1, len(p) * min(p)))
    # Never more lenient than Benjamini and Hochberg, never stricter than Bonferroni.
    assert (adjusted >= false_discovery_control(p) - 1e-12).all()
    assert (adjusted <= np.minimum(1, len(p) * np.array(p)) + 1e-12).all()


def test_the_whole_table_is_adjusted_at_once() -> None:
    rng = np.random.default_rng(0)
    trials = study({"a": rng.uniform(size=(3, 10)), "b": rng.uniform(size=(3, 10))})
    table = compare(pd.concat([trials, trials.assign(sensor="partial")]))
    assert len(table) == 4
    np.testing.assert_allclose(table["p_holm"], holm(table["p"].to_numpy()))


def test_ranks_tie_what_cannot_be_told_apart() -> None:
    rng = np.random.default_rng(0)
    good, same = rng.uniform(0, 1, size=(2, 4, 20))
    trials = study(
        {"best": good, "equal": same, "worse": 2 + good, "fails": np.full((4, 20), np.inf)}
    )
    comparisons = compare(trials)
    names = pd.DataFrame({"estimator": ["fails", "equal", "best", "worse"]})
    table = names.assign(scenario="two_player", sensor="full", trials=80)
    assert ranks(comparisons, table, "position_error").tolist() == [4, 1, 1, 3]


def test_one_estimator_alone_has_no_rank() -> None:
    trials = study({"a": np.ones((2, 3))})
    comparisons = compare(trials)
    assert comparisons.empty
    table = trials[["scenario", "sensor", "estimator"]].drop_duplicates().assign(trials=6)
    assert ranks(comparisons, table, "cosine_error").isna().all()


def test_who_was_run_on_a_small_part_of_the_trials_has_no_rank_and_takes_none() -> None:
    """It is compared on the shared trials; the others are ranked as if it did not exist."""
    errors = {"good": np.full((4, 20), 0.1), "bad": np.full((4, 20), 0.5)}
    part = {"part": np.full((4, 5), 0.01), "nearly": np.full((4, 17), 0.2)}
    comparisons = compare(study(errors | part))
    own = comparisons[(comparisons["error"] == "cosine_error")].set_index(["estimator", "other"])
    assert own.loc[("good", "part"), "pairs"] == 20
    assert own.loc[("good", "part"), "p_holm"] < 0.05
    names = pd.DataFrame({"estimator": ["good", "bad", "part", "nearly"]})
    table = names.assign(scenario="two_player", sensor="full", trials=[80, 80, 20, 68])
    found = ranks(comparisons, table, "position_error")
    assert found.fillna(0).tolist() == [1, 3, 0, 2]
    leading = leaders(table.assign(e_rank=found, e_median=[0.1, 0.5, 0.01, 0.2]), "e")
    assert leading.tolist() == [True, False, False, False]


@pytest.mark.parametrize(
    ("levels", "seeds", "drawn", "ranked"),
    [(4, 40, 20, True), (4, 40, 19, False), (4, 60, 23, False), (1, 20, 10, False)],
)
def test_a_large_part_of_the_trials_is_ranked(
    levels: int, seeds: int, drawn: int, ranked: bool
) -> None:
    """At least 40 % of the trials, on at least 20 draws of a family."""
    errors = {"best": (drawn, 0.1), "good": (seeds, 0.2), "bad": (seeds, 0.5)}
    scenario = "random(num_players=3)"
    trials = study({name: np.full((levels, n), e) for name, (n, e) in errors.items()}, scenario)
    names = pd.DataFrame({"estimator": list(errors)}).assign(scenario=scenario, sensor="full")
    table = names.assign(trials=[levels * n for n, _ in errors.values()])
    found = ranks(compare(trials), table, "position_error")
    assert found.fillna(0).tolist() == ([1, 2, 3] if ranked else [0, 1, 2])


def test_the_floor_takes_nobodys_rank() -> None:
    """If equal weights happen to be the truth, the best contender still comes first."""
    errors = np.zeros((4, 20)), np.full((4, 20), 0.1), np.full((4, 20), 0.5)
    names = pd.DataFrame({"estimator": ["uniform", "near", "far"]})
    table = names.assign(scenario="two_player", sensor="full", trials=80)
    for order, expected in (((0, 1, 2), [1, 1, 2]), ((2, 0, 1), [3, 1, 2])):
        found = study(dict(zip(names["estimator"], (errors[k] for k in order), strict=True)))
        assert ranks(compare(found), table, "position_error").tolist() == expected


@pytest.mark.parametrize(
    ("scenario", "seeds", "ranked"),
    [
        ("random(num_players=3)", 5, False),
        ("random(num_players=3)", 6, True),
        ("two_player", 1, False),
        ("two_player", 2, True),
    ],
)
def test_too_few_units_have_no_rank(scenario: str, seeds: int, ranked: bool) -> None:
    """Three levels of two draws are six trials, but two draws of a family."""
    trials = study({"a": np.zeros((3, seeds)), "b": np.ones((3, seeds))}, scenario)
    names = pd.DataFrame({"estimator": ["a", "b"]}).assign(
        scenario=scenario, sensor="full", trials=9
    )
    found = ranks(compare(trials), names, "position_error")
    assert found.notna().tolist() == [ranked] * 2


def test_leaders_are_better_than_somebody() -> None:
    table = pd.DataFrame(
        [
            ("one", "best", 1, 0.1, True),
            ("one", "fails", 1, np.inf, False),
            ("one", "uniform", 1, 0.0, False),
            ("one", "worse", 3, 0.5, False),
            ("two", "a", 1, 0.1, False),
            ("two", "b", 1, 0.2, False),
            ("few", "a", pd.NA, 0.1, False),
        ],
        columns=["scenario", "estimator", "cosine_error_rank", "cosine_error_median", "leads"],
    ).assign(sensor="full")
    table = table.astype({"cosine_error_rank": "Int64"})
    assert leaders(table, "cosine_error").tolist() == table["leads"].tolist()

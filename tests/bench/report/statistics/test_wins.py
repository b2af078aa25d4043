"""Draws won, against counts made by hand."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest

from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.statistics.estimator_comparison import holm
from olne_bench.bench.report.statistics.wins import ALL, win_counts, win_table
from olne_bench.bench.report.study import Study

STUDY = Study(
    scenarios={
        "fixed": ScenarioEntry(name="two_player", label="fixed"),
        **{n: ScenarioEntry(name="random", label=n, family=True) for n in ("one", "two")},
    }
)


def trials(scenario: str, errors: dict[str, list[list[float]]]) -> pd.DataFrame:
    """Trials of estimators with these errors (draws, trials of a draw); infinite ones failed."""
    rows = []
    for estimator, table in errors.items():
        for (seed, level), error in np.ndenumerate(np.array(table, dtype=float)):
            fine = np.isfinite(error)
            rows.append(
                {
                    "scenario": scenario,
                    "sensor": "full",
                    "sigma": 0.1 * (1 + level),
                    "seed": seed,
                    "estimator": estimator,
                    "status": "ok" if fine else "crash",
                    "position_error": error if fine else np.nan,
                    "cosine_error": error if fine else np.nan,
                    "count": 1,
                }
            )
    return pd.DataFrame(rows)


def position(table: pd.DataFrame) -> pd.DataFrame:
    return table[table["error"] == "position_error"].set_index("scenario")


HAND = {
    "a": [[1, 1, 1], [1, 1, 9], [np.inf, 9, 9], [1, 1, 1], [np.inf] * 3],
    "b": [[2, 2, 2], [2, 2, 2], [2, 2, 2], [2, 1, 0.5], [np.inf] * 3],
}


def test_a_draw_goes_to_who_wins_most_of_its_trials() -> None:
    row = position(win_counts(trials("one", HAND), STUDY)).loc["one"]
    assert (row["estimator"], row["other"]) == ("a", "b")
    assert (row["won"], row["even"], row["lost"]) == (2, 2, 1)


def test_in_a_fixed_scenario_each_noise_draw_counts() -> None:
    row = position(win_counts(trials("fixed", HAND), STUDY)).loc["fixed"]
    assert (row["won"], row["even"], row["lost"]) == (6, 4, 5)


def test_sensors_of_a_draw_are_counted_together() -> None:
    full = trials("one", {"a": [[1.0]], "b": [[2.0]]})
    other = trials("one", {"a": [[3.0, 3.0]], "b": [[2.0, 2.0]]}).assign(sensor="partial")
    row = position(win_counts(pd.concat([full, other]), STUDY)).loc["one"]
    assert (row["won"], row["even"], row["lost"]) == (0, 0, 1)


def test_all_scenarios_add_up() -> None:
    rng = np.random.default_rng(0)
    parts = [
        trials(name, {"a": rng.uniform(0, 1, (k, 3)).tolist(), "b": rng.uniform(0, 2, (k, 3))})
        for name, k in (("one", 12), ("two", 30))
    ]
    table = win_table(win_counts(pd.concat(parts), STUDY))
    rows = position(table)
    assert list(rows.index) == [ALL, "one", "two"]
    for name in ("won", "even", "lost", "draws"):
        assert rows.loc[ALL, name] == rows.loc[["one", "two"], name].sum()
    assert rows["draws"].tolist() == [42, 12, 30]
    for row in rows.to_dict("records"):
        assert row["wins"] == pytest.approx((row["won"] + row["even"] / 2) / row["draws"])
        assert row["wins_low"] < row["wins"] < row["wins_high"]
        exact = binomtest(row["won"], row["won"] + row["lost"]).pvalue
        assert row["p"] == pytest.approx(exact)
    np.testing.assert_allclose(table["p_holm"], holm(table["p"].to_numpy()))
    width = rows["wins_high"] - rows["wins_low"]
    assert width[ALL] < width["one"]


def test_only_common_trials_are_paired() -> None:
    table = trials("one", {"a": [[1.0], [1.0]], "b": [[2.0], [2.0]], "c": [[3.0], [3.0]]})
    part = table[(table["estimator"] != "c") | (table["seed"] == 0)]
    counts = position(win_counts(part, STUDY)).set_index(["estimator", "other"])
    assert counts["won"].to_dict() == {("a", "b"): 2, ("a", "c"): 1, ("b", "c"): 1}
    declined = part.assign(status=part["status"].where(part["estimator"] != "c", "skipped"))
    assert len(position(win_counts(declined, STUDY))) == 1


def test_one_estimator_or_one_scenario() -> None:
    alone = win_table(win_counts(trials("one", {"a": [[1.0]]}), STUDY))
    assert alone.empty and "p_holm" in alone
    assert ALL not in set(win_table(win_counts(trials("one", HAND), STUDY))["scenario"])


def test_equal_estimators_rarely_win() -> None:
    rng, found = np.random.default_rng(1), []
    for _ in range(60):
        errors = {name: rng.uniform(size=(20, 2)).tolist() for name in ("a", "b")}
        found.append(position(win_table(win_counts(trials("one", errors), STUDY)))["p"].iloc[0])
    assert np.mean(np.array(found) < 0.05) <= 0.12

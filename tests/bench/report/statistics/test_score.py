"""The score: right, paired, at equal data, and kind to nobody who fails."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry
from olne_bench.bench.report.statistics.score import (
    ALL,
    best_group,
    board_rows,
    log_errors,
    pair_table,
    references,
    score_table,
)
from olne_bench.bench.report.study import Study

NAMES = ("map", "kkt_constrained", "bilevel", "uniform")
STUDY = Study(
    metrics=BUILT_IN,
    scenarios={
        "road": ScenarioEntry(name="random", label="road", family=True),
        "two_player": ScenarioEntry(name="two_player", label="two_player"),
    },
    estimators={name: EstimatorEntry(name=name, label=name) for name in NAMES},
)


def trials(factors: dict[str, float], seeds: dict[str, int] | None = None, **changes: object):
    """Errors of the draws times a factor for each estimator."""
    rng = np.random.default_rng(0)
    rows = []
    for scenario in ("road", "two_player"):
        for sigma in (0.0, 0.1, 0.5):
            for seed in range(10):
                hard = sigma * rng.uniform(0.5, 2)
                for name, factor in factors.items():
                    if seed >= (seeds or {}).get(name, 10):
                        continue
                    rows.append(
                        {"scenario": scenario, "sensor": "full", "sigma": sigma, "seed": seed}
                        | {"estimator": name, "count": 1, "status": "ok"}
                        | {"position_error": factor * hard, "cosine_error": hard / 10}
                        | changes
                    )
    return pd.DataFrame(rows)


def whole(table: pd.DataFrame, error: str = "position_error") -> pd.DataFrame:
    chosen = (table["error"] == error) & (table["scenario"] == ALL) & table["sigma"].isna()
    return table[chosen].set_index("estimator")


FACTORS = {"map": 0.8, "kkt_constrained": 1.0, "bilevel": 1.0, "uniform": 9.0}


def test_a_score_is_the_geometric_mean_of_the_ratios() -> None:
    table = whole(score_table(log_errors(trials(FACTORS), STUDY), STUDY))
    for name, factor in FACTORS.items():
        assert table.loc[name, "score"] == pytest.approx(factor)
        assert table.loc[name, "score_low"] == pytest.approx(factor)  # the same in all draws
    assert (table["reference"] == "kkt_constrained").all()
    assert table["trials"].unique().tolist() == [40]  # none without noise
    assert table["draws"].unique().tolist() == [10 + 20]  # a family's draw has all noise levels
    assert table["ranked"].to_dict() == {name: name != "uniform" for name in FACTORS}


def test_intervals_and_tests_tell_a_difference_from_noise() -> None:
    rng = np.random.default_rng(1)
    told = trials(FACTORS)
    told["position_error"] *= np.exp(0.2 * rng.normal(size=len(told)))
    logs = log_errors(told, STUDY)
    table = whole(score_table(logs, STUDY))
    assert 0.7 < table.loc["map", "score_low"] < 0.8 < table.loc["map", "score_high"] < 0.92
    assert table.loc["bilevel", "score_low"] < 1 < table.loc["bilevel", "score_high"]
    pairs = pair_table(logs, STUDY)
    own = pairs[(pairs["error"] == "position_error") & (pairs["scenario"] == ALL)]
    p = own.set_index(["estimator", "other"])["p_holm"]
    assert p["kkt_constrained", "map"] < 0.01 and p["bilevel", "kkt_constrained"] > 0.05
    assert set(own["estimator"]) | set(own["other"]) == {"map", "kkt_constrained", "bilevel"}
    ranked = ["map", "bilevel", "kkt_constrained"]
    assert best_group(own, ranked) == ["map"]
    assert best_group(own, ranked[1:]) == ["bilevel", "kkt_constrained"]
    assert best_group(own, []) == []


def test_chance_alone_is_rarely_significant() -> None:
    same, found = trials({"map": 1.0, "bilevel": 1.0}), []
    for seed in range(16):
        noise = np.exp(np.random.default_rng(seed).normal(size=len(same)))
        told = same.assign(position_error=same["position_error"] * noise)
        pairs = pair_table(log_errors(told, STUDY), STUDY)
        found += pairs.loc[pairs["error"] == "position_error", "p"].tolist()
    assert np.mean(np.array(found) < 0.05) < 0.12


def test_only_draws_that_all_share_count() -> None:
    """Who sees more draws has no other score for it; who sees a few only does not rank."""
    seeds = {"map": 10, "bilevel": 5, "kkt_constrained": 10, "uniform": 10}
    table = whole(score_table(log_errors(trials(FACTORS, seeds), STUDY), STUDY))
    assert table["trials"].unique().tolist() == [20]
    table = whole(score_table(log_errors(trials(FACTORS, seeds | {"bilevel": 3}), STUDY), STUDY))
    assert table.loc["map", "trials"] == 40 and table.loc["bilevel", "trials"] == 12
    assert not table.loc["bilevel", "ranked"]


def test_cells_that_an_estimator_lacks_are_left_out_for_all() -> None:
    told = trials(FACTORS)
    told = told[(told["estimator"] != "bilevel") | (told["scenario"] == "road")]
    table = score_table(log_errors(told, STUDY), STUDY)
    assert whole(table)["trials"].unique().tolist() == [20]
    assert whole(table)["ranked"].sum() == 3
    of_scenario = table[(table["scenario"] == "two_player") & (table["sensor"] == ALL)]
    assert set(of_scenario["estimator"]) == {"map", "kkt_constrained", "uniform"}


def test_a_failure_counts_as_uniform_and_never_pays() -> None:
    told = trials(FACTORS)
    lost = (told["estimator"] == "map") & (told["seed"] == 0)
    told.loc[lost, "status"] = "crash"
    table = whole(score_table(log_errors(told, STUDY), STUDY))
    assert table.loc["map", "failures"] == 4
    assert table.loc["map", "median"] < np.inf
    assert table.loc["map", "score"] == pytest.approx(0.8**0.9 * 9**0.1)
    truth = told["estimator"] == "uniform"  # equal weights happen to be the truth
    told.loc[truth, "position_error"] = 0.0
    table = whole(score_table(log_errors(told, STUDY), STUDY))
    assert table.loc["map", "score"] == pytest.approx(0.8**0.9)  # as the paper's method


def test_a_bad_estimator_moves_no_score_of_another() -> None:
    told = trials(FACTORS)
    told.loc[(told["estimator"] == "map") & (told["seed"] == 0), "status"] = "crash"
    worse = told["position_error"].where(told["estimator"] != "bilevel", 1e3)
    before = whole(score_table(log_errors(told, STUDY), STUDY))
    after = whole(score_table(log_errors(told.assign(position_error=worse), STUDY), STUDY))
    assert after.loc["bilevel", "score"] > 100
    others = before.index.drop("bilevel")
    assert after.loc[others, "score"].tolist() == before.loc[others, "score"].tolist()


def test_where_nobody_guesses_a_failure_counts_as_the_largest_error_of_its_trial() -> None:
    told = trials({"bilevel": 2.0, "map": 1.0, "ridge": 3.0})
    told.loc[(told["estimator"] == "bilevel") & (told["seed"] == 0), "status"] = "crash"
    table = whole(score_table(log_errors(told, STUDY), STUDY))
    assert table.loc["bilevel", "score"] == pytest.approx(2**0.9 * 3**0.1)


def test_without_the_papers_method_the_first_one_is_the_reference() -> None:
    logs = log_errors(trials({"bilevel": 2.0, "map": 1.0}), STUDY)
    assert references(logs, STUDY) == {"position_error": "map", "cosine_error": "map"}
    assert whole(score_table(logs, STUDY)).loc["bilevel", "score"] == pytest.approx(2.0)


def test_boards_have_ranked_estimators_first_and_floors_last() -> None:
    boards = board_rows(score_table(log_errors(trials(FACTORS), STUDY), STUDY), STUDY)
    assert list(boards) == ["position_error", "cosine_error"]
    assert boards["position_error"]["estimator"].tolist()[0] == "map"
    assert boards["position_error"]["estimator"].tolist()[-1] == "uniform"


@pytest.mark.parametrize("part", ["no noise", "floor only", "skipped"])
def test_nothing_to_compare_has_no_score(part: str) -> None:
    told = trials(FACTORS)
    chosen = {
        "no noise": told[told["sigma"] == 0],
        "floor only": told[told["estimator"] == "uniform"],
        "skipped": told.assign(status="skipped"),
    }[part]
    logs = log_errors(chosen, STUDY)
    assert score_table(logs, STUDY).empty and pair_table(logs, STUDY).empty
    assert board_rows(score_table(logs, STUDY), STUDY) == {}


def test_few_draws_have_a_score_without_an_interval() -> None:
    told = trials(FACTORS)
    told = told[(told["seed"] < 2) & (told["scenario"] == "road")]
    table = whole(score_table(log_errors(told, STUDY), STUDY))
    assert table["score"].notna().all() and table["score_low"].isna().all()

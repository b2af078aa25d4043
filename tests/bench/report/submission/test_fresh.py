"""A fresh salt refuses errors that are too good, and no others."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.submission.fresh import LEVEL, FreshErrors, compare_fresh

STUDY = Study(scenarios={"s": ScenarioEntry(name="two_player", label="s")})
METRIC = declare(PositionError)


def table(errors: np.ndarray) -> pd.DataFrame:
    """Rows of one estimator with these errors (levels, seeds); infinite ones are failures."""
    rows = [
        {
            "scenario": "s",
            "sensor": "full",
            "sigma": 0.01 * (level + 1),
            "seed": seed,
            "estimator": "e",
            "count": 1,
            "status": "ok" if np.isfinite(error) else "crash",
            "position_error": error if np.isfinite(error) else np.nan,
        }
        for level, row in enumerate(errors)
        for seed, error in enumerate(row)
    ]
    return pd.DataFrame(rows)


def compare(submitted: np.ndarray, fresh: np.ndarray) -> FreshErrors:
    (found,) = compare_fresh(table(submitted), table(fresh), METRIC, STUDY)
    return found


def test_errors_of_one_distribution_are_accepted_at_the_level_that_is_stated() -> None:
    rng = np.random.default_rng(0)
    scale = 10.0 ** np.arange(4)[:, None]  # levels of very different errors
    chances = [
        compare(scale * rng.exponential(size=(4, 8)), scale * rng.exponential(size=(4, 3))).p
        for _ in range(25)
    ]
    assert min(chances) > LEVEL
    assert 0.3 < np.mean(chances) < 0.7


@pytest.mark.parametrize("factor", [20.0, np.inf])
def test_errors_that_are_much_larger_with_a_fresh_salt_are_refused(factor: float) -> None:
    rng = np.random.default_rng(1)
    honest = rng.exponential(size=(4, 3))
    found = compare(rng.exponential(size=(4, 8)), honest * factor + 5)
    assert not found.accepted
    assert found.trials == 12
    assert found.fresh > found.submitted


def test_smaller_errors_are_no_reason_to_refuse() -> None:
    rng = np.random.default_rng(2)
    assert compare(rng.exponential(size=(4, 8)) + 5, rng.exponential(size=(4, 3))).p > 0.99


def test_only_cells_that_were_run_fresh_count() -> None:
    submitted = np.ones((4, 8))
    submitted[3] = 0.0
    found = compare(submitted, np.ones((3, 4)))
    assert found.submitted == 1.0
    assert found.p == 1.0


def test_too_few_rows_decide_nothing() -> None:
    assert not compare(np.zeros((1, 1)), np.ones((1, 20))).decides
    assert compare(np.zeros((1, 4)), np.ones((1, 20))).decides


@pytest.mark.parametrize(("submitted", "fresh"), [(1, 998), (1, 1000), (999, 1), (1001, 1)])
def test_a_test_decides_where_chance_can_be_as_small_as_its_level(submitted, fresh) -> None:
    """The rarest of n + 1 equally likely orders has a chance of 1 / (n + 1)."""
    rng = np.random.default_rng(3)
    found = compare(rng.uniform(size=(1, submitted)), rng.uniform(size=(1, fresh)))
    assert found.decides == (submitted + fresh > 1 / LEVEL)


def test_orders_of_cells_multiply() -> None:
    """3 cells with 2 of 5 errors each: 10 times 10 times 10 orders, one too few."""
    assert not compare(np.zeros((3, 3)), np.ones((3, 2))).decides
    assert compare(np.zeros((4, 3)), np.ones((4, 2))).decides
    assert not compare(np.zeros((3, 2)), np.ones((3, 3))).decides


def test_the_chance_is_that_of_all_orders() -> None:
    """The largest of n errors is the fresh one in one of n orders."""
    for largest, chance in ((9.0, 1 / 5), (2.5, 3 / 5), (0.0, 1.0)):
        found = compare(np.array([[1.0, 2.0, 3.0, 4.0]]), np.array([[largest]]))
        assert found.p == pytest.approx(chance, abs=0.02)
    ties = compare(np.ones((2, 4)), np.ones((2, 2)))
    assert ties.p == 1.0


def test_both_orders_of_few_errors_have_the_chance_they_have() -> None:
    """Two fresh ones are the largest of four in one of six orders."""
    found = compare(np.array([[1.0, 2.0]]), np.array([[3.0, 4.0]]))
    assert found.p == pytest.approx(1 / 6, abs=0.02)
    assert (found.submitted, found.fresh, found.trials) == (1.5, 3.5, 2)
    # Cells of other sizes have ranks in proportion: neither counts for more.
    two = compare_fresh(
        pd.concat([table(np.array([[1.0, 2.0]])), table(np.array([[1.0], [1.0]])).iloc[1:]]),
        table(np.array([[3.0], [2.0]])),
        METRIC,
        STUDY,
    )
    assert two[0].p == pytest.approx(1 / 6, abs=0.02)


def test_estimators_are_compared_one_by_one() -> None:
    mine, yours = table(np.ones((1, 5))), table(np.full((1, 5), 2.0)).assign(estimator="a")
    found = compare_fresh(pd.concat([mine, yours]), pd.concat([mine, yours]), METRIC, STUDY)
    assert [(one.estimator, one.submitted, one.fresh) for one in found] == [
        ("a", 2.0, 2.0),
        ("e", 1.0, 1.0),
    ]
    assert {one.metric for one in found} == {"position_error"}


def test_the_level_itself_is_accepted() -> None:
    usual = FreshErrors("e", "position_error", 1, 1.0, 1.0, LEVEL, decides=True)
    assert usual.accepted
    assert not FreshErrors("e", "position_error", 1, 1.0, 1.0, LEVEL * 0.999, True).accepted

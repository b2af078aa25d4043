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

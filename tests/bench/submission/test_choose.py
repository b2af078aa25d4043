"""Which rows are run again: enough by chance, and those that look forged."""

from math import comb
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.submission.choose import (
    MOST_SUSPICIOUS,
    POWER,
    SHARE,
    choose,
    needed,
    suspicions,
)
from olne_bench.bench.submission.rows import Rows

METRIC = declare(PositionError)


@pytest.mark.parametrize("rows", [1, 2, 19, 20, 21, 44, 132, 1000, 50_000])
def test_the_sample_is_the_smallest_that_finds_forgers(rows: int) -> None:
    forged = max(1, -(-rows * 5 // 100))
    assert SHARE == 0.05

    def missed(drawn: int) -> float:
        return comb(rows - forged, drawn) / comb(rows, drawn)

    number = needed(rows)
    assert missed(number) <= 1 - POWER + 1e-12
    assert missed(number - 1) > 1 - POWER
    assert number <= 70  # however many rows there are


def table(own: np.ndarray, rival: np.ndarray) -> pd.DataFrame:
    """Errors (cells, seeds) of a plugin and of a rival; infinite ones are failures."""
    rows = [
        {"estimator": name, "scenario": "s", "sensor": "full", "sigma": 0.1 * cell, "seed": seed}
        | {"position_error": error if np.isfinite(error) else np.nan, "cosine_limit": 1e-9}
        | {"status": "ok" if np.isfinite(error) else "crash", "cosine_error": 1.0}
        for name, errors in (("own", own), ("rival", rival))
        for cell, levels in enumerate(errors)
        for seed, error in enumerate(levels)
    ]
    return pd.DataFrame(rows)


def honest(rng: np.random.Generator, cells: int = 4, seeds: int = 100) -> np.ndarray:
    found: np.ndarray = 10.0 ** np.arange(cells)[:, None] * rng.uniform(0.5, 2, (cells, seeds))
    return found


def chosen(rows: pd.DataFrame, sample: int | None = None, seed: int = 0) -> set[int]:
    planned: Any = {
        (str(k),): SimpleNamespace(plugin="own" if name == "own" else "", k=k)
        for k, name in enumerate(rows["estimator"])
    }
    places = {key: trial.k for key, trial in planned.items()}
    rng = np.random.default_rng(seed)
    found: Any = choose(planned, Rows(rows, None, places), METRIC, sample, rng)  # type: ignore[arg-type]
    assert [t.k for t in found] == sorted(t.k for t in found)
    return {trial.k for trial in found}


def test_plugins_and_rivals_each_have_enough_rows() -> None:
    rng = np.random.default_rng(0)
    rows = table(honest(rng), honest(rng))
    found = chosen(rows)
    for name in ("own", "rival"):
        assert rows.loc[[*found], "estimator"].eq(name).sum() == needed(400) + MOST_SUSPICIOUS
    assert chosen(rows, seed=1) != found
    few = rows.loc[[*chosen(rows, sample=10)], "estimator"].value_counts()
    assert few.to_dict() == {"own": 12, "rival": 12}
    assert len(chosen(rows, sample=10**6)) == len(rows)


def test_skipped_trials_are_a_group_of_their_own() -> None:
    rng = np.random.default_rng(0)
    rows = table(honest(rng), honest(rng))
    rows.loc[rows["seed"] >= 10, "status"] = "skipped"
    found = rows.loc[[*chosen(rows)]]
    own = found[found["estimator"] == "own"]["status"].value_counts()
    assert own["ok"] == 40  # all that were not skipped
    assert own["skipped"] == needed(360) + MOST_SUSPICIOUS


@pytest.mark.parametrize("seed", range(5))
def test_what_looks_forged_is_run_again(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = table(honest(rng), honest(rng))
    forged = [17, 230, 401, 790]
    rows.loc[forged, "position_error"] *= [1e-6, 1e-3, 1e3, 30]
    assert set(forged) <= chosen(rows, seed=seed)
    # Rows below the statistical limit, and those of a cell that is better than the best rival's.
    rows.loc[33, "cosine_error"] = 1e-14
    assert 33 in chosen(rows, seed=seed)


def test_suspicion_is_a_logarithm_of_a_ratio() -> None:
    rows = table(np.array([[1.0, 10.0, 100.0]]), np.array([[1.0, 10.0, np.inf]]))
    found = suspicions(rows, {"own"}, METRIC)
    assert found[:3] == pytest.approx([1.0, 0.0, -1.0])
    assert found[3:] == pytest.approx([-1.0, 0.0, 1.0])  # of rivals, large ones; failures as ten
    assert not suspicions(rows, {"own"}, None).any()


def test_a_cell_that_is_too_good_as_a_whole_is_suspicious_beside_the_best_rival() -> None:
    rows = table(np.full((1, 3), 1e-6), np.ones((1, 3)))
    assert suspicions(rows, {"own"}, METRIC)[:3] == pytest.approx([6.0] * 3)
    # The floor is no rival.
    floor = rows.replace("rival", "uniform")
    assert suspicions(floor, {"own"}, METRIC)[:3] == pytest.approx([0.0] * 3)

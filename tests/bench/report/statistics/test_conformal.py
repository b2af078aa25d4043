"""Radii that hold further draws, whatever drives."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.statistics.conformal import FEWEST, conformal_table, distances
from olne_bench.bench.report.study import Study
from tests.bench.report.conftest import trial_row

DRAWS = 99


def world(label: str, **options: object) -> ScenarioEntry:
    told = {"of": "merge", "change": "alone"} | options
    return ScenarioEntry(name="changed", label=label, options=told)


STUDY = Study(
    scenarios={"true": world("true", dial=0.0), "other": world("other", dial=1.0)},
    metrics=BUILT_IN,
)


def trials(label: str, far: np.ndarray, **more: object) -> pd.DataFrame:
    rows = [
        trial_row(scenario=label, seed=k, estimator="map", farthest_ahead=one, **more)
        for k, one in enumerate(far)
    ]
    return pd.DataFrame(rows)


def table(*parts: pd.DataFrame, study: Study = STUDY) -> pd.DataFrame:
    whole = pd.concat(parts, ignore_index=True)
    return conformal_table(distances(whole, study), study).set_index("scenario")


def test_radii_of_either_world() -> None:
    true = np.arange(1.0, DRAWS + 1)
    found = table(trials("true", true), trials("other", 2 * true))
    assert list(found["draws"]) == [DRAWS, DRAWS]
    assert found.loc["true", "radius"] == 90  # of 100 ranks
    assert found.loc["other", "radius"] == 180
    assert found.loc["other", "radius_as_told"] == 90
    assert found.loc["other", "held_as_told"] == pytest.approx(45 / DRAWS)
    assert found.loc["true", "held_as_told"] == pytest.approx(90 / DRAWS)
    assert found["held"].between(0.88, 0.94).all()


@pytest.mark.parametrize("heavy", [0.5, 1.0, 3.0])
def test_further_draws_are_held_whatever_their_distribution(heavy: float) -> None:
    rng = np.random.default_rng(1)
    held = [table(trials("other", rng.pareto(heavy, 20))).loc["other", "held"] for _ in range(40)]
    assert 0.9 - 0.02 <= np.mean(held) <= 10 / 11 + 0.02  # k of n + 1, with n of one half


def test_a_failure_is_infinitely_far_away() -> None:
    far = np.ones(40)
    rows = trials("other", far)
    rows.loc[:9, "status"] = "not_converged"
    assert table(rows).loc["other", "radius"] == np.inf
    rows.loc[:9, "status"] = "harness_error"  # no attempts
    assert table(rows).loc["other", "draws"] == 30


def test_few_draws_calibrate_nothing() -> None:
    far = np.ones(FEWEST - 1)
    assert table(trials("other", far)).empty
    found = table(trials("other", np.ones(FEWEST)))
    assert found.loc["other", "radius"] == 1 and np.isnan(found.loc["other", "radius_as_told"])


def test_only_metrics_that_are_radii_count() -> None:
    plain = tuple(replace(one, radius=False) for one in BUILT_IN)
    assert table(trials("other", np.ones(40)), study=replace(STUDY, metrics=plain)).empty

"""Results by temperament, against counts made by hand."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.scene import NoScenes
from olne_bench.bench.report.statistics.recognition import (
    NOBODY,
    confusion_table,
    drivers,
    is_tempered,
    temperament_table,
)
from olne_bench.bench.report.study import Study
from olne_bench.envs.roads.temperaments import TEMPERAMENTS, checked_shares, recognised
from tests.bench.report.conftest import trial_row

SEEDS = 12
MEANS = {name: np.array(a) / sum(a) for name, a in TEMPERAMENTS.items()}


@pytest.fixture(scope="module")
def study(tempered) -> Study:
    return tempered([2, 4])


@pytest.fixture(scope="module")
def truth(study) -> Callable[[int], tuple[tuple[str, ...], np.ndarray]]:
    """Temperaments and weights of a draw."""
    scenes = [study.scenes.truth("road", seed) for seed in range(SEEDS)]
    return lambda seed: (scenes[seed].temperaments, scenes[seed].weights)


def row(estimator: str, seed: int, weights: object, status: str = "ok", **more: object) -> dict:
    place = {"scenario": "road", "sigma": 0.1, "seed": seed, "estimator": estimator}
    return trial_row(**place | {"status": status, "weights": weights} | more)


@pytest.fixture(scope="module")
def trials(truth) -> pd.DataFrame:
    """Estimates: the true weights, those of a normal driver for all, and half of them failed."""
    rows = []
    for seed in range(SEEDS):
        _, weights = truth(seed)
        normal = np.tile(MEANS["normal"], (len(weights), 1))
        rows.append(row("exact", seed, weights.tolist()))
        rows.append(row("exact", seed, weights.tolist(), sigma=0.5, status="failed_forward"))
        rows.append(row("always normal", seed, normal.tolist()))
        broken = "timeout" if seed % 2 else "ok"
        rows.append(row("half", seed, None if seed % 2 else weights.tolist(), status=broken))
        rows.append(row("declines", seed, None, status="skipped"))
        rows.append(row("exact", seed, np.ones((2, 4)).tolist(), scenario="two"))
    return pd.DataFrame(rows)


def test_every_driver_of_every_attempt_counts_once(trials, study, truth) -> None:
    found = drivers(trials, study)
    number = sum(len(truth(seed)[0]) for seed in range(SEEDS))
    assert len({len(truth(seed)[0]) for seed in range(SEEDS)}) == 3
    counts = found.groupby(["estimator", "sigma"]).size().to_dict()
    assert counts == {
        ("always normal", 0.1): number,
        ("exact", 0.1): number,
        ("exact", 0.5): number,
        ("half", 0.1): number,
    }
    exact = found[(found["estimator"] == "exact") & (found["sigma"] == 0.1)]
    names = [name for seed in range(SEEDS) for name in truth(seed)[0]]
    assert exact["temperament"].tolist() == names
    weights = np.concatenate([truth(seed)[1] for seed in range(SEEDS)])
    assert exact["recognised"].tolist() == recognised(weights, checked_shares(None)).tolist()
    np.testing.assert_allclose(exact["cosine_error"], 0, atol=1e-12)
    failed = found[(found["estimator"] == "half") & (found["seed"] % 2 == 1)]
    assert failed["recognised"].eq(NOBODY).all() and np.isinf(failed["cosine_error"]).all()


def test_the_table_counts_by_temperament(trials, study, truth) -> None:
    found = drivers(trials, study)
    table = temperament_table(found).set_index(["estimator", "sigma", "temperament"])
    names = np.array([name for seed in range(SEEDS) for name in truth(seed)[0]])
    for name in TEMPERAMENTS:
        line = table.loc[("always normal", 0.1, name)]
        assert line["drivers"] == (names == name).sum()
        assert line["recognised"] == (name == "normal")
        own = np.concatenate([truth(seed)[1] for seed in range(SEEDS)])[names == name]
        angles = 1 - own.sum(axis=1) / (2 * np.linalg.norm(own, axis=1))
        assert line["cosine_error_median"] == pytest.approx(np.median(angles))
        half = table.loc[("half", 0.1, name)]
        at_odd = [n for seed in range(1, SEEDS, 2) for n in truth(seed)[0]]
        assert half["failures"] == at_odd.count(name)
    both = table[table.index.get_level_values("sigma").isna()]
    assert both.loc["exact"]["drivers"].sum() == 2 * len(names)
    within = table["recognised_low"].le(table["recognised"] + 1e-12)
    assert (within | table["recognised_low"].isna()).all()


def test_confusions_are_shares_of_the_true_temperament(trials, study) -> None:
    table = confusion_table(drivers(trials, study))
    sums = table.groupby(["estimator", "sigma", "temperament"])["share"].sum()
    np.testing.assert_allclose(sums, 1)
    always = table[table["estimator"] == "always normal"]
    assert set(always["recognised"]) == {"normal"}
    assert (table[table["estimator"] == "half"]["recognised"] == NOBODY).sum() == 3


def test_other_scenarios_have_no_temperaments(trials, study) -> None:
    assert is_tempered("road", study) and not is_tempered("two", study)
    assert not is_tempered("unheard of", study)
    nothing = drivers(trials[trials["scenario"] == "two"], study)
    assert nothing.empty
    assert temperament_table(nothing).empty and confusion_table(nothing).empty
    assert drivers(trials, replace(study, scenes=NoScenes())).empty

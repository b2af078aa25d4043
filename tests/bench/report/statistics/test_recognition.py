"""Results by temperament, against counts made by hand."""

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.statistics.recognition import (
    NOBODY,
    confusion_table,
    drivers,
    is_tempered,
    temperament_table,
)
from olne_bench.bench.report.study import Study
from olne_bench.envs.roads.temperaments import TEMPERAMENTS, checked_shares, recognised
from olne_bench.envs.scenarios import check_options
from tests.bench.report.conftest import trial_row

OPTIONS = {"weights": "temperaments", "num_players": [2, 4]}
ROAD = ScenarioEntry(name="intersection", label="road", options=OPTIONS, family=True)
STUDY = Study(
    scenarios={"road": ROAD, "two": ScenarioEntry(name="two_player", label="two")}, salt="s"
)
SEEDS = 12
MEANS = {name: np.array(a) / sum(a) for name, a in TEMPERAMENTS.items()}


def truth(seed: int) -> tuple[tuple[str, ...], np.ndarray]:
    own = STUDY.draw("road", seed).seed
    family = check_options("intersection", **OPTIONS)
    return family.temperaments(own), family.tempered(own)


def row(estimator: str, seed: int, weights: object, status: str = "ok", **more: object) -> dict:
    place = {"scenario": "road", "sigma": 0.1, "seed": seed, "estimator": estimator}
    return trial_row(**place | {"status": status, "weights": weights} | more)


@pytest.fixture(scope="module")
def trials() -> pd.DataFrame:
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


def test_every_driver_of_every_attempt_counts_once(trials) -> None:
    found = drivers(trials, STUDY)
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


def test_the_table_counts_by_temperament(trials) -> None:
    found = drivers(trials, STUDY)
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


def test_confusions_are_shares_of_the_true_temperament(trials) -> None:
    table = confusion_table(drivers(trials, STUDY))
    sums = table.groupby(["estimator", "sigma", "temperament"])["share"].sum()
    np.testing.assert_allclose(sums, 1)
    always = table[table["estimator"] == "always normal"]
    assert set(always["recognised"]) == {"normal"}
    assert (table[table["estimator"] == "half"]["recognised"] == NOBODY).sum() == 3


def test_other_scenarios_have_no_temperaments(trials) -> None:
    assert is_tempered("road", STUDY) and not is_tempered("two", STUDY)
    assert not is_tempered("unheard of", STUDY)
    nothing = drivers(trials[trials["scenario"] == "two"], STUDY)
    assert nothing.empty
    assert temperament_table(nothing).empty and confusion_table(nothing).empty
    changed = ROAD.model_copy(update={"options": {"weights": "temperaments", "shares": {"odd": 1}}})
    assert drivers(trials, Study(scenarios={"road": changed}, salt="s")).empty

"""A fresh salt refuses errors that are too good, and no others."""

from collections import Counter

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.submission.fresh import (
    LEVEL,
    MOST,
    FreshErrors,
    compare_fresh,
    fresh_trials,
    has_truth,
    orders,
    stratum_of,
)

METRIC = declare(PositionError)


def table(errors: np.ndarray, sensors: tuple[str, ...] = ("full",)) -> pd.DataFrame:
    """Rows of one estimator with errors (levels, seeds, sensors); infinite ones are failures."""
    rows = [
        {
            "scenario": "s",
            "sensor": sensor,
            "sigma": 0.01 * (level + 1),
            "seed": seed,
            "salt_id": "x",
            "estimator": "e",
            "observation_error": 0.1,
            "status": "ok" if np.isfinite(error) else "crash",
            "position_error": error if np.isfinite(error) else np.nan,
        }
        for level, row in enumerate(errors)
        for seed, units in enumerate(np.asarray(row).reshape(len(row), -1))
        for sensor, error in zip(sensors, units, strict=True)
    ]
    return pd.DataFrame(rows)


def compare(
    submitted: np.ndarray, fresh: np.ndarray, families: tuple[str, ...] = (), level: float = LEVEL
) -> FreshErrors:
    return compare_fresh(table(submitted), table(fresh), METRIC, families, level)


def test_errors_of_one_distribution_are_accepted_at_the_level_that_is_stated() -> None:
    rng = np.random.default_rng(0)
    scale = 10.0 ** np.arange(4)[:, None]  # levels of very different errors
    chances = np.array(
        [
            compare(
                scale * rng.exponential(size=(4, 8)),
                scale * rng.exponential(size=(4, 3)),
                level=0.1,
            ).p
            for _ in range(60)
        ]
    )
    assert (chances < 0.1).mean() < 0.2  # both tests together
    assert (chances < 0.02).mean() < 0.07


@pytest.mark.parametrize("families", [(), ("s",)])
def test_few_seeds_that_share_much_are_few(families: tuple[str, ...]) -> None:
    """Sensors of one draw, and noise levels of a family, are no independent evidence."""
    rng = np.random.default_rng(1)
    low = 0
    for _ in range(60):
        draw = rng.exponential(size=(2, 1, 7))
        draw = np.repeat(draw, 4, axis=1) if families else rng.exponential(size=(2, 4, 7))
        both = np.repeat(draw[..., None], 3, axis=-1)
        old, new = (
            table(np.moveaxis(part, 0, 0), ("a", "b", "c"))
            for part in (both[0][:, :3], both[1][:, :4])
        )
        low += compare_fresh(old, new, METRIC, families, 0.1).p < 0.1
    assert low / 60 < 0.2


@pytest.mark.parametrize("factor", [20.0, np.inf])
def test_errors_that_are_much_larger_with_a_fresh_salt_are_refused(factor: float) -> None:
    rng = np.random.default_rng(1)
    honest = rng.exponential(size=(4, 3))
    found = compare(rng.exponential(size=(4, 8)), honest * factor + 5)
    assert not found.accepted
    assert found.trials == 12
    assert found.fresh > found.submitted


def test_a_part_that_is_known_by_heart_is_found() -> None:
    """Ranks hardly differ, but none of the fresh ones is among the best."""
    rng = np.random.default_rng(2)
    submitted = rng.uniform(1, 2, (4, 40))
    submitted[:, :6] = 1e-3
    assert not compare(submitted, rng.uniform(1, 2, (4, 25))).accepted
    submitted[:, :6] = 1.0
    assert compare(submitted, rng.uniform(1, 2, (4, 15))).accepted


def test_smaller_errors_are_no_reason_to_refuse() -> None:
    rng = np.random.default_rng(2)
    assert compare(rng.exponential(size=(4, 8)) + 5, rng.exponential(size=(4, 3))).p > 0.9


def test_only_cells_that_were_run_fresh_count() -> None:
    submitted = np.ones((4, 8))
    submitted[3] = 0.0
    found = compare(submitted, np.ones((3, 4)))
    assert found.submitted == 1.0
    assert found.p == 1.0


def test_declined_trials_are_failures_and_draws_without_a_truth_are_not() -> None:
    rng = np.random.default_rng(3)
    old, new = table(rng.exponential(size=(4, 8))), table(rng.exponential(size=(4, 4)))
    declined = new.assign(status="skipped")
    assert not compare_fresh(old, declined, METRIC, ()).accepted
    without = pd.concat([new, new.assign(status="skipped", observation_error=np.nan, seed=50)])
    found = compare_fresh(old, without, METRIC, ())
    assert found.p == compare_fresh(old, new, METRIC, ()).p
    assert has_truth(without).sum() == 16
    nothing = without[without["seed"] == 50]
    assert not compare_fresh(old, nothing, METRIC, ()).decides


@pytest.mark.parametrize(("units", "enough"), [(18, False), (19, True)])
def test_there_are_enough_units_if_chance_can_be_ruled_out(units: int, enough: bool) -> None:
    """The rarest of the orders has to be rarer than half the level: there are two tests."""
    assert (orders([(3, 1)]), orders([(3, 2), (2, 2)]), orders([])) == (4, 60, 1)
    rng = np.random.default_rng(3)
    found = compare(rng.uniform(size=(1, units)), rng.uniform(size=(1, 4)) + 9)
    assert found.decides == (orders([(units, 4)]) > 2 / LEVEL) == enough
    assert not found.accepted


def test_the_chance_is_that_of_all_orders() -> None:
    """The largest of n errors is the fresh one in one of n orders; both tests count."""
    for largest, chance in ((9.0, 2 / 5), (2.5, 1.0), (0.0, 1.0)):
        found = compare(np.array([[1.0, 2.0, 3.0, 4.0]]), np.array([[largest]]))
        assert found.p == pytest.approx(chance, abs=0.02)
    assert compare(np.ones((2, 4)), np.ones((2, 2))).p == 1.0


def test_the_level_itself_is_accepted() -> None:
    usual = FreshErrors("e", "position_error", 1, 1.0, 1.0, LEVEL, decides=True)
    assert usual.accepted
    assert not FreshErrors("e", "position_error", 1, 1.0, 1.0, LEVEL * 0.999, True).accepted
    assert not FreshErrors("e", "position_error", 1, 1.0, 1.0, 1.0, decides=False).accepted


def trials_of(suite: str, seeds: int, estimator: str = "uniform") -> list[Trial]:
    return [t for t in expand(load_suite(suite), seeds) if t.estimator.label == estimator]


@pytest.mark.parametrize(("suite", "seeds"), [("quick", 2), ("quick", 5), ("calibration", 3)])
def test_fresh_trials_are_whole_units_with_seeds_of_a_run(suite: str, seeds: int) -> None:
    own = trials_of(suite, seeds)
    rng = np.random.default_rng(0)
    for number, level in ((48, 0.05), (144, LEVEL)):
        fresh = fresh_trials(own, number, level, rng)
        assert number <= len(fresh) <= MOST
        assert len({t.key for t in fresh}) == len(fresh)
        assert {t.salt for t in fresh}.isdisjoint({t.salt for t in own})
        assert all(len(t.salt) >= 16 for t in fresh)
        assert {t.seed for t in fresh} <= set(range(seeds))
        assert all(t.sigma > 0 or t.scenario.family for t in fresh)
        units = Counter((stratum_of(t), t.salt, t.seed) for t in fresh)
        cells = {stratum: n for (stratum, _, _), n in units.items()}
        assert all(n == cells[stratum] for (stratum, _, _), n in units.items())
        counts = Counter(stratum for stratum, _, _ in units)
        assert orders((seeds, n) for n in counts.values()) * level > 2
    salts = {t.salt for t in fresh_trials(own, 48, 0.05, rng)}
    assert salts.isdisjoint({t.salt for t in fresh})


def test_few_seeds_ask_for_more_trials_and_one_is_too_few() -> None:
    one = [t for t in trials_of("paper", 5) if (t.sigma, t.scenario.label) == (0.1, "two_player")]
    rng = np.random.default_rng(0)
    assert len(fresh_trials(one, 10, LEVEL, rng)) == 2 * 13  # comb(18, 5) > 8000 > comb(17, 5)
    assert fresh_trials([t for t in one if t.seed == 0], 10, LEVEL, rng) == []
    assert fresh_trials([t for t in one if t.sigma == 0], 10, LEVEL, rng) == []

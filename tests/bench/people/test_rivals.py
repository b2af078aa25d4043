"""What is learnt from other cars, and nothing from the car itself."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.bench.people.cases import HORIZONS, Case
from olne_bench.bench.people.rivals import fitted_to, shares_of
from olne_bench.games.model.weight_prior import WeightPrior


def case(seed: int, piece: int, road: str = "road") -> Case:
    """Drives on at the mean of its own and its leader's speed."""
    rng = np.random.default_rng(seed)
    speeds = rng.uniform(8, 14, 3)
    ahead = np.array(HORIZONS)
    happened = np.column_stack([ahead * (speeds[0] + speeds[1]) / 2, 0 * ahead])
    straight = np.column_stack([ahead * speeds[0], 0 * ahead])
    predicted = {"straight": straight, "game": straight + np.array([0.5, 0.1])}
    predicted["alone"] = predicted["game"]
    gaps = rng.uniform(15, 40, 2)
    return Case(
        road, f"piece {piece}", "calm", happened, predicted, straight, gaps, speeds, gaps * 0
    )


CASES = [case(k, k % 6) for k in range(60)]


def test_regressions_find_a_linear_law():
    rivals = fitted_to(CASES)
    for own in (case(100, 0), case(101, 1)):
        found = rivals.predicted(own)
        assert found["ridge"] == pytest.approx(own.happened, abs=0.6)
        worst = np.abs(found["kernel"] - own.happened)[:, 0].max()
        assert worst < 0.4 * np.abs(found["straight"] - own.happened)[:, 0].max()
        assert set(found) == {"straight", "game", "alone", "idm", "mobil", "ridge", "kernel"}


def test_spreads_are_mean_errors_on_the_road_or_on_all():
    rivals = fitted_to(CASES)
    off = [np.abs(c.predicted["game"] - c.happened) for c in CASES]
    assert rivals.spread("game", "road") == pytest.approx(np.mean(off, axis=0))
    assert rivals.spread("game", "elsewhere") == pytest.approx(rivals.spread("game", "road"))


def test_samples_are_weighed_by_another_prior():
    samples = np.stack([np.full((2, 4), 0.25), np.tile([0.97, 0.01, 0.01, 0.01], (2, 1))])
    own = replace(CASES[0], samples=samples)
    assert shares_of(own, WeightPrior((20.0,)))[0] > 0.999
    assert shares_of(own, WeightPrior((1.0,))) == pytest.approx([0.5, 0.5])

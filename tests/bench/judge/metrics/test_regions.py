"""Metrics of regions: their width, and their calibration around random points."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.region_width import RegionWidth
from olne_bench.bench.judge.metrics.tarp_level import TarpLevel

PLAYERS, COUNT = 2, 3


def case(weights: np.ndarray, sigma: float = 0.1, **given: object) -> SimpleNamespace:
    fields = {"region": "samples", "samples": None, "covariance": None, "weights": weights}
    return SimpleNamespace(weights=weights, sigma=sigma, estimate=SimpleNamespace(**fields | given))


def draw(rng: np.random.Generator, number: int, power: float = 1.0) -> np.ndarray:
    return rng.dirichlet(np.full(COUNT, power), size=(number, PLAYERS))


def test_levels_around_random_points_are_uniform_for_the_right_samples_only() -> None:
    rng = np.random.default_rng(0)
    truths = draw(rng, 300)
    right = [TarpLevel().score(case(one, samples=draw(rng, 100))) for one in truths]
    narrow = [TarpLevel().score(case(one, samples=draw(rng, 100, 20.0))) for one in truths]
    assert kstest(right, "uniform").pvalue > 0.01
    assert kstest(narrow, "uniform").pvalue < 1e-6


def test_the_random_point_depends_on_the_samples_alone() -> None:
    rng = np.random.default_rng(1)
    samples = draw(rng, 50)
    one, other = draw(rng, 2)
    levels = [TarpLevel().score(case(truth, samples=samples)) for truth in (one, other, one)]
    assert levels[0] == levels[2] != levels[1]


def test_widths_of_a_covariance_and_of_its_samples_agree() -> None:
    rng = np.random.default_rng(2)
    factor = 0.01 * rng.standard_normal((PLAYERS * COUNT, PLAYERS * COUNT))
    covariance = factor @ factor.T
    weights = np.full((PLAYERS, COUNT), 1 / COUNT)
    noise = rng.multivariate_normal(np.zeros(PLAYERS * COUNT), covariance, 4000)
    samples = weights + noise.reshape(-1, PLAYERS, COUNT)
    known = RegionWidth().score(case(weights, region="covariance", covariance=covariance))
    assert known is not None
    assert formulas.sample_width(samples) == pytest.approx(known, rel=0.05)
    doubled = case(weights, region="covariance", covariance=4 * covariance)
    assert RegionWidth().score(doubled) == pytest.approx(2 * known)


def test_a_likelihood_region_has_the_width_of_its_covariance() -> None:
    weights = np.full((PLAYERS, COUNT), 1 / COUNT)
    given = case(weights, region="likelihood", covariance=1e-4 * np.eye(6))
    assert RegionWidth().score(given) == pytest.approx(0.01)
    assert RegionWidth().score(case(weights, region="likelihood")) is None


def test_nothing_is_uncertain_without_noise_or_region() -> None:
    weights = np.full((PLAYERS, COUNT), 1 / COUNT)
    samples = draw(np.random.default_rng(0), 40)
    assert TarpLevel().score(case(weights, sigma=0.0, samples=samples)) is None
    assert TarpLevel().score(case(weights)) is None
    assert RegionWidth().score(case(weights, sigma=0.0, samples=samples)) is None
    assert RegionWidth().score(case(weights, region=None, samples=samples)) is None

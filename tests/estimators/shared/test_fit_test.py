"""The fit test: its level, what it notices, and where nothing can be tested."""

from dataclasses import replace

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.estimators.protocol import FIT_LEVEL
from olne_bench.estimators.shared.fit_test import Expected, FitTest, fit_test
from olne_bench.estimators.shared.forward_model import uniform_weights

RNG = np.random.default_rng(0)
SEEN = np.ones((25, 2, 4), dtype=bool)


@pytest.fixture(scope="module")
def expected() -> Expected:
    seen = SEEN.copy()
    seen[3, 0] = False
    derivative = 20 * RNG.standard_normal((int(seen.sum()), 14))
    return Expected.of(seen, derivative, np.ones(14))


def drawn(expected: Expected, rng: np.random.Generator) -> np.ndarray:
    """Residuals of a true model: noise without what 14 parameters take."""
    seen = expected.layout.seen
    basis, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((int(seen.sum()), 14)))
    noise = rng.standard_normal(int(seen.sum()))
    full = np.full(seen.shape, np.nan)
    full[seen] = noise - basis @ (basis.T @ noise)
    return full


def test_a_true_model_is_refused_as_often_as_the_level_says(expected) -> None:
    rng = np.random.default_rng(2)
    values = np.array([expected.test(drawn(expected, rng)).p for _ in range(600)], dtype=float)
    assert 0.001 <= (values < FIT_LEVEL).mean() <= 0.025
    assert 0.4 < values.mean() < 0.6


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r: 1.5 * r, "1.5 times the noise"),
        (lambda r: 0.6 * r, "times the noise that is told"),
        (lambda r: (r + 0.9 * np.roll(np.nan_to_num(r), 1, axis=0)) / 1.35, "follow each other"),
        (
            lambda r: np.where(np.arange(r.size).reshape(r.shape) % 29 == 0, 4.0, 0.7 * r),
            "outliers",
        ),
    ],
)
def test_it_says_what_does_not_fit(expected, change, said) -> None:
    found = expected.test(change(drawn(expected, np.random.default_rng(3))))
    assert found.verdict == "does not fit"
    assert said in str(found)


def test_it_says_which_player_does_not_fit(expected) -> None:
    residuals = drawn(expected, np.random.default_rng(4))
    residuals[:, 1] *= 1.6
    found = expected.test(residuals)
    assert found.players[1] < FIT_LEVEL < found.players[0]


def test_few_samples_are_not_testable() -> None:
    seen = np.zeros((5, 1, 4), dtype=bool)
    seen[:4] = True
    expected = Expected.of(seen, 1e3 * RNG.standard_normal((16, 12)), np.ones(12))
    found = expected.test(RNG.standard_normal(seen.shape))
    assert found.p is None
    assert str(found).startswith("not testable: 16 samples are 4 more than was fitted")


def test_an_estimate_is_tested() -> None:
    scenario = ob.scenario("two_player")
    problem, seen = ob.observe(scenario, "partial", 0.05, seed=0)
    estimate = ob.estimate(problem, seen, "kkt_constrained").result
    theta = estimate.theta(problem.game)
    assert fit_test(problem, seen, estimate.states, theta).verdict == "fits"
    doubled = replace(problem, sigma=0.025)
    assert fit_test(doubled, seen, estimate.states, theta).verdict == "does not fit"


def test_what_has_no_motion_or_no_noise_is_not_testable() -> None:
    problem, seen = ob.observe(ob.scenario("two_player"), "full", 0.05)
    uniform = uniform_weights(problem)
    assert "no motion" in fit_test(problem, seen, None, uniform).reason
    silent = replace(problem, sigma=0.0)
    assert "no noise" in fit_test(silent, seen, seen.y, uniform).reason
    assert isinstance(fit_test(problem, seen, np.zeros_like(seen.y), uniform), FitTest)


def test_a_level_that_is_not_known_is_that_of_the_residuals(expected) -> None:
    residuals = 3 * drawn(expected, np.random.default_rng(5))
    assert expected.test(residuals).verdict == "does not fit"
    assert expected.test(residuals, level_known=False).verdict == "fits"


def test_an_estimate_with_weights_of_zero_is_tested_at_the_peak() -> None:
    """The maximum of the likelihood is far from the peak there; all methods are tested alike."""
    scenario = ob.scenario("highway_overtaking", seed=0)
    problem, seen = ob.observe(scenario, sensor="full", sigma=0.09, seed=15)
    found = [ob.estimate(problem, seen, name) for name in ("kkt_constrained", "map")]
    assert found[0].weights.min() < 1.1e-5
    assert found[0].fit.p == pytest.approx(found[1].fit.p, abs=0.05) and found[1].fit.p > 0.1

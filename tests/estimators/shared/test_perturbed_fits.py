"""Fits of perturbed errors, on densities that are known."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

from olne_bench.estimators.shared.perturbed_fits import (
    Fits,
    Peak,
    counts_of,
    effective_sample_size,
    perturbed_fits,
    resampled,
    tempered,
)
from olne_bench.estimators.shared.posterior_density import climbed


def peak(density, point) -> Peak:
    return Peak.at(climbed(density, density.place(point)))


def fitted(density, peaks, **settings) -> Fits:
    limits = {"first": 400, "more": 100, "most": 400, "enough": 1e9} | settings
    return perturbed_fits(density, peaks, np.random.default_rng(0), **limits)


def test_of_a_gaussian_all_fits_count_alike(densities) -> None:
    density = densities.gaussian()
    found = fitted(density, [peak(density, np.zeros(3))], first=2000, most=2000)
    assert found.asked == 2000
    assert found.effective == pytest.approx(2000, rel=1e-6)
    assert found.lost == 0
    assert found.split_r_hat < 1.01
    points = found.points
    np.testing.assert_allclose(points.mean(axis=0), densities.gaussian_mean, atol=0.07)
    covariance = densities.gaussian_root @ densities.gaussian_root.T
    np.testing.assert_allclose(np.cov(points.T), covariance, atol=0.1)


def test_weights_make_up_for_a_bend(densities) -> None:
    density = densities.bent()
    found = fitted(density, [peak(density, [0.3, 0.2])], first=3000, most=3000)
    weights, points = found.shares, found.points
    assert weights.sum() == pytest.approx(1)
    assert found.effective > 1000
    assert weights @ points[:, 0] ** 2 == pytest.approx(1.0, abs=0.1)
    assert weights @ points[:, 1] == pytest.approx(0.5, abs=0.05)
    assert weights @ points[:, 1] ** 2 == pytest.approx(0.25 + 0.75, abs=0.12)


def test_no_fit_is_lost_in_a_narrow_bent_valley(densities) -> None:
    density = densities.valley()
    found = fitted(density, [peak(density, np.zeros(7))])
    assert found.lost == 0
    assert found.effective > 399
    assert found.tried < 4 * found.asked


def test_two_peaks_keep_their_probability(densities) -> None:
    density = densities.two_peaks()
    peaks = [peak(density, [3.9, 0.0]), peak(density, [-3.9, 0.0])]
    found = fitted(density, peaks, first=1000, most=1000)
    left = found.points[:, 0] < 0
    assert found.shares[left].sum() == pytest.approx(0.75, abs=0.04)
    counts = counts_of(peaks, 1000)
    assert sum(counts) == 1000
    assert counts[1] / counts[0] == pytest.approx(np.sqrt(3), rel=0.01)


def test_further_fits_start_where_the_first_do_not_reach(densities) -> None:
    """From the peak of a ring, only one half of it is reached."""
    density = densities.ring()
    settings = {"first": 300, "more": 300}
    alone = fitted(density, [peak(density, [2.0, 0.0])], **settings, most=300)
    found = fitted(density, [peak(density, [2.0, 0.0])], **settings, most=3000, enough=1500)
    assert found.effective > 4 * alone.effective
    around = np.arctan2(*found.points.T[::-1])
    shares, _ = np.histogram(around, bins=4, range=(-np.pi, np.pi), weights=found.shares)
    np.testing.assert_allclose(shares, densities.ring_quarters, atol=0.04)


def test_fits_end_when_they_suffice(densities) -> None:
    density = densities.gaussian()
    top = [peak(density, np.zeros(3))]
    assert fitted(density, top, enough=450, most=4000).asked == 500
    assert fitted(density, top, enough=450, most=450).asked == 400


def test_hopeless_fits_end_early(densities) -> None:
    density = densities.gaussian()
    top = [peak(density, np.zeros(3))]
    assert fitted(density, top, enough=13_000, most=4000).asked == 1500
    assert fitted(density, top, enough=11_000, most=4000).asked == 4000


def test_points_without_density_are_lost(densities) -> None:
    density = densities.cut()
    found = fitted(density, [peak(density, [1.0, 0.0])])
    assert (found.points[:, 0] > -1).all()
    assert found.lost == pytest.approx(norm.cdf(-1), abs=0.06)


def test_a_place_from_which_nothing_is_reached_gives_no_points(densities) -> None:
    density = densities.of(lambda points: np.where(np.abs(points[:, :1]) < 1e-3, points, np.nan))
    found = fitted(density, [Peak.at(density.place([0.0, 0.0]))])
    assert found.lost == 1
    assert found.effective == 0
    assert found.points.shape == (0, 2)


def test_only_fits_beyond_a_fold_are_lost(densities) -> None:
    density = densities.folded()
    found = fitted(density, [peak(density, [0.2])], first=2000, most=2000)
    largest = 1.04**2 / 2 / np.hypot(1.0, 0.2)  # of Q'F, where its derivative is zero
    assert found.lost == pytest.approx(norm.cdf(-largest), abs=0.03)
    assert np.isfinite(found.log_weights).all()
    assert (found.points < 1.04).all()


def test_a_direction_that_changes_nothing_is_refused(densities) -> None:
    density = densities.of(lambda points: points[:, :1] - points[:, 1:] + np.zeros((1, 2)))
    with pytest.raises(np.linalg.LinAlgError):
        Peak.at(density.place([0.0, 0.0]))


def test_equal_weights_are_all_effective() -> None:
    assert effective_sample_size(np.full(50, -700.0)) == pytest.approx(50)
    assert effective_sample_size(np.array([0.0, -800.0])) == pytest.approx(1)
    assert effective_sample_size(np.full(3, -np.inf)) == 0


def test_one_point_cannot_have_all_the_weight(densities) -> None:
    logs = np.append(np.zeros(99), 50.0)
    places = densities.gaussian().place(np.zeros(3)).at(np.zeros(100, dtype=int))
    fits = Fits([places], logs - logsumexp(logs), 100, 100)
    counts = np.bincount(resampled(fits.shares, 1000, np.random.default_rng(0)), minlength=100)
    assert counts.sum() == 1000
    assert counts[99] >= 990  # the others have no weight to speak of
    even = Fits([places], np.full(100, -np.log(100)), 100, 100)
    counts = np.bincount(resampled(even.shares, 1000, np.random.default_rng(0)), minlength=100)
    assert counts.max() <= 11


def test_parts_that_disagree_have_a_large_r_hat(densities) -> None:
    places = densities.gaussian().reach(
        np.random.default_rng(0).standard_normal((400, 3)),
        densities.gaussian().place(np.zeros(3)).at(np.zeros(400, dtype=int)),
    )
    assert Fits([places], np.full(400, -np.log(400)), 400, 400).split_r_hat < 1.05
    heavy = np.append(np.zeros(399), 12.0)
    assert Fits([places], heavy - logsumexp(heavy), 400, 400).split_r_hat > 1.2


def test_shares_are_tempered_until_enough_particles_are_effective():
    log_shares = np.append(-20 * np.random.default_rng(0).uniform(size=100), -np.inf)
    found, power = tempered(log_shares, 50.0)
    assert 0 < power < 1
    assert effective_sample_size(found) == pytest.approx(50, rel=1e-4)
    np.testing.assert_allclose(np.diff(found[:2] / log_shares[:2]), 0, atol=1e-12)
    assert found[-1] == -np.inf
    np.testing.assert_array_equal(tempered(log_shares, 2.0)[0], log_shares)
    np.testing.assert_array_equal(tempered(np.array([0.0, -9.0]), 5.0)[0], [0, 0])

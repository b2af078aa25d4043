"""The noise level that nobody tells."""

from dataclasses import replace

import numpy as np
import pytest

import olne_bench as ob
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared import noise_level
from olne_bench.estimators.shared.noise_level import most_probable_level, with_found_noise


def seen(sigma: float, seed: int = 0) -> tuple[Problem, ob.Observation]:
    return ob.observe(ob.scenario("two_player"), "partial", sigma, seed=seed)


def test_a_wide_prior_leaves_the_level_of_the_residuals() -> None:
    assert most_probable_level(1.0, 3.0, 300 * 0.2**2, 300.0) == pytest.approx(0.2, rel=1e-3)


def test_a_narrow_prior_is_kept_where_there_are_few_samples() -> None:
    assert most_probable_level(1.0, 0.01, 5 * 0.2**2, 5.0) == pytest.approx(1.0, rel=0.01)
    assert 0.2 < most_probable_level(1.0, 0.5, 5 * 0.2**2, 5.0) < 1.0


@pytest.mark.parametrize(("squared", "left"), [(0.0, 100.0), (1.0, -3.0), (1e300, 1.0)])
def test_the_level_stays_near_its_prior(squared: float, left: float) -> None:
    assert np.exp(-8.1) < most_probable_level(1.0, 1.0, squared, left) < np.exp(8.1)


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_the_level_is_found(factor: float) -> None:
    problem, one = seen(0.05)
    asked = replace(problem, sigma=0.05 * factor, sigma_spread=1.0)
    found = with_found_noise(asked, (one,), np.inf)
    assert found.sigma == pytest.approx(0.05, rel=0.15)
    assert not found.sigma_spread
    assert with_found_noise(problem, (one,), np.inf) is problem


def test_a_search_is_repeated_only_where_a_smaller_level_no_longer_explains(monkeypatch) -> None:
    problem, one = seen(0.05)
    searches, attempts = [], noise_level.joint_attempts

    def counted(asked, y, settings, deadline):
        searches.append(asked.sigma)
        return attempts(asked, y, settings, deadline)

    monkeypatch.setattr(noise_level, "joint_attempts", counted)
    for factor in (0.3, 3.0):
        searches.clear()
        found = with_found_noise(
            replace(problem, sigma=0.05 * factor, sigma_spread=1.0), (one,), np.inf
        )
        assert len(searches) == 1 and found.sigma == pytest.approx(0.05, rel=0.15)
    # A search that ended early, at what only the larger level explains: at the smaller it goes on.
    searches.clear()
    wide, narrow = replace(problem, sigma=5.0), replace(problem, sigma=1e-4)
    fit = noise_level._BestFit(wide, one.y, np.inf)
    assert [fit.searched_again(asked) for asked in (wide, narrow, narrow)] == [False, True, False]
    assert searches == [5.0, 1e-4]


def test_what_no_likely_level_explains_is_searched_from_all_starts(monkeypatch) -> None:
    """Bent data, told as nearly free of noise: the search does not end at what it finds first."""
    problem, one = seen(0.05)
    tries, attempts = [], noise_level.joint_attempts

    def counted(*given):
        for attempt in attempts(*given):
            tries.append(attempt)
            yield attempt

    monkeypatch.setattr(noise_level, "joint_attempts", counted)
    found = with_found_noise(replace(problem, sigma=1e-3, sigma_spread=1.0), (one,), np.inf)
    assert len(tries) > 6 and found.sigma == pytest.approx(0.02, rel=0.2)  # three deviations off


@pytest.mark.parametrize("name", ["kkt_constrained", "map", "ridge", "bilevel", "ukf", "posterior"])
def test_methods_with_a_likelihood_find_it(name: str) -> None:
    problem, one = seen(0.05)
    asked = replace(problem, sigma=0.1, sigma_spread=1.0)
    there = ob.estimate(asked, one, name).result
    known = ob.estimate(problem, one, name).result
    assert there.extras["sigma"] == pytest.approx(0.05, rel=0.15)
    assert there.extras["objective"] == pytest.approx(known.extras["objective"], rel=0.05)
    assert "sigma" not in known.extras


def test_what_no_level_can_be_is_refused() -> None:
    problem, _ = seen(0.05)
    for given, said in (
        ({"sigma_spread": -1.0}, "sigma_spread must be"),
        ({"sigma_spread": np.nan}, "sigma_spread must be"),
        ({"sigma": 0.0, "sigma_spread": 1.0}, "needs a sigma above 0"),
    ):
        with pytest.raises(ValueError, match=said):
            replace(problem, **given)

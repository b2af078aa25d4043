"""Priors of the starts of players that the first sample misses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Observation
from olne_bench.estimators.shared.unseen_starts import unseen_starts


def missing(observation: Observation, *places: tuple[int, int]) -> Observation:
    """Without the samples (step, player)."""
    y = observation.y.copy()
    for place in places:
        y[place] = np.nan
    return Observation(y)


def test_nothing_is_believed_of_players_in_the_first_sample(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.05)
    assert unseen_starts(problem, observation) is None
    assert unseen_starts(problem, missing(observation, (3, 0), (-1, 1))) is None
    start = unseen_starts(problem, missing(observation, (0, 1)))
    assert np.isinf(start.deviation[0]).all()
    assert np.isfinite(start.deviation[1]).all()


def test_the_later_a_player_is_seen_the_wider_is_the_prior_of_its_start(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.01)
    late = unseen_starts(problem, missing(observation, (0, 0)))
    later = unseen_starts(problem, missing(observation, (0, 0), (1, 0), (2, 0)))
    assert (later.deviation[0, :2] > 2 * late.deviation[0, :2]).all()
    truth = seen()[1][0].y[0, 0]
    for one in (late, later):
        assert (np.abs(one.mean[0] - truth) < 2 * one.deviation[0]).all()


def test_the_fastest_player_says_how_wide(seen) -> None:
    """A player that has braked to a stop may have come fast."""
    problem, (observation,), _ = seen()
    y = observation.y.copy()
    y[:, 0, :2] = y[-1, 0, :2]
    y[:, 0, 3] = 0.0
    start = unseen_starts(problem, missing(Observation(y), (0, 0)))
    steps = len(y) - 1
    speed = np.linalg.norm(y[-1, 1, :2] - y[0, 1, :2]) / steps / problem.game.dt
    assert start.deviation[0, 3] == pytest.approx(speed / 2)
    assert start.deviation[0, :2] == pytest.approx(speed * problem.game.dt / 2)
    assert start.deviation[0, 2] == 0.5


def test_players_of_which_no_sample_is_complete_do_not_count(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.05)
    y = observation.y.copy()
    y[:, 1, 2] = np.nan
    start = unseen_starts(problem, missing(Observation(y), (0, 0)))
    assert np.isfinite(start.deviation[0]).all()


def test_it_is_a_factor_of_the_posterior(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.05)
    gappy, rng = missing(observation, (0, 1)), np.random.default_rng(0)
    start = unseen_starts(problem, gappy)
    density, peaks = Posterior().peaks(problem, gappy, np.inf)
    place = peaks[0].place
    flat = replace(density, start=None)
    before = (
        density.reach(place.points, place).log_density - flat.reach(place.points, place).log_density
    )
    _, x_1 = density.split(place.points)
    factor = norm.logpdf(x_1[0, 1], start.mean[1], start.deviation[1])
    factor -= norm.logpdf(0, 0, start.deviation[1])
    assert before[0] == pytest.approx(factor.sum(), rel=1e-4)
    found = Posterior().estimate(problem, gappy, rng=rng, budget=60)
    assert found.converged
    assert found.extras["effective_sample_size"] > 400

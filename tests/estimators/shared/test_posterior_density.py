"""Errors of games and their derivatives, and priors of starts that nobody saw."""

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.forward_model import SolvedGame, play_batch, squared_error_of
from olne_bench.estimators.shared.posterior_density import (
    GameDensity,
    StartPrior,
    climbed,
    start_prior,
)
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.olne import solve_olne


def noisy(view: str, scenario, game) -> tuple[Problem, Observation, SolvedGame]:
    truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    y = observe(VIEWS[view], game.dynamics, truth.states)
    y = y + 0.02 * np.random.default_rng(0).standard_normal(y.shape)
    y[2, 0, 1] = np.nan
    count = game.parameters.count
    means = np.zeros((game.num_players, count)) if count else None
    problem = Problem(game, VIEWS[view], 0.02, noise_scale=(1.0, 2.0, 0.5, 1.0)[: y.shape[2]])
    return problem, Observation(y), SolvedGame(truth, scenario.weights, means)


def followed(problem: Problem, seen: Observation, seconds: float = 60.0) -> GameDensity:
    return GameDensity(problem, seen, NormalChart.of(problem), time.monotonic() + seconds)


@pytest.fixture(scope="module")
def crossing():
    scenario = get_scenario("two_player", 0)
    return noisy("full", scenario, scenario.game)


def test_the_density_is_that_of_the_posterior(crossing) -> None:
    problem, seen, known = crossing
    density = followed(problem, seen)
    place = density.place(known)
    squared = squared_error_of(problem, known.root.states, seen.y)
    prior = (place.points[0, : density.chart.size] ** 2).sum()
    expected = -squared / (2 * problem.sigma**2) - prior / 2
    assert place.log_density[0] == pytest.approx(expected)


def test_a_prior_of_starts_is_a_factor_of_the_density(crossing) -> None:
    problem, seen, known = crossing
    mean = known.root.states[0] + 0.1
    deviation = np.linspace(0.1, 0.8, mean.size).reshape(mean.shape)
    flat = followed(problem, seen)
    told = replace(flat, start=StartPrior(mean, deviation))
    here, there = (density.place(known) for density in (flat, told))
    factor = norm.logpdf(known.root.states[0], mean, deviation) - norm.logpdf(0, 0, deviation)
    assert there.log_density[0] == pytest.approx(here.log_density[0] + factor.sum())
    assert np.linalg.matrix_rank(there.rows[0][len(here.rows[0]) :]) == mean.size


@pytest.mark.parametrize("known_start", [False, True])
@pytest.mark.parametrize("view", ["full", "partial"])
def test_rows_are_the_derivatives_of_errors(view, known_start) -> None:
    scenario = get_scenario("unknown_goals", 0)
    problem, seen, known = noisy(view, scenario, scenario.told)
    density = followed(problem, seen)
    if known_start:
        mean = known.root.states[0]
        density = replace(density, start=StartPrior(mean, np.full(mean.shape, 0.2)))
    start = density.place(SolvedGame(known.root, known.weights, known.parameters))
    # goals at their means are not those of the known game: from there, Newton's method finds it
    place = density.reach(start.points, start)
    assert place.possible[0]
    size = place.points.shape[1]
    near = place.at(np.zeros(size, dtype=int))
    ahead, behind = (density.reach(near.points + e * np.eye(size), near) for e in (1e-4, -1e-4))
    slopes = (ahead.errors - behind.errors).T / 2e-4
    np.testing.assert_allclose(place.rows[0], slopes, rtol=1e-3, atol=1e-3 * np.abs(slopes).max())


def test_games_are_those_of_the_batch_solver(crossing) -> None:
    problem, seen, known = crossing
    density = followed(problem, seen)
    place = density.place(known)
    points = place.points + 0.05 * np.random.default_rng(0).standard_normal((20, 14))
    found = density.reach(points, place.at(np.zeros(20, dtype=int)))
    assert found.possible.all()
    theta, start = density.split(points)
    batch = play_batch(problem, known, theta, start)
    states = found.roots[:, :, :8].reshape(batch.states.shape)
    np.testing.assert_allclose(states, batch.states, atol=1e-5)


def test_climbing_ends_at_a_peak(crossing) -> None:
    problem, seen, known = crossing
    density = followed(problem, seen)
    place = density.place(known)
    peak = climbed(density, place)
    assert peak.log_density[0] > place.log_density[0]
    slope = peak.rows[0].T @ peak.errors[0]
    covariance = np.linalg.inv(peak.rows[0].T @ peak.rows[0])
    assert np.sqrt(slope @ covariance @ slope) < 0.05  # distance left, in standard deviations


def test_nothing_is_possible_without_equilibrium_or_time(crossing) -> None:
    problem, seen, known = crossing
    density = followed(problem, seen)
    place = density.place(known)
    far = density.reach(place.points + np.append(np.zeros(6), np.full(8, 1e6)), place)
    assert not far.possible[0]
    assert far.log_density[0] == -np.inf
    late = followed(problem, seen, seconds=-1.0)
    assert late.late
    assert not late.reach(place.points + 0.01, place).possible[0]


def missing(observation: Observation, *places: tuple[int, int]) -> Observation:
    """Without the samples (step, player)."""
    y = observation.y.copy()
    for place in places:
        y[place] = np.nan
    return Observation(y)


def test_nothing_is_believed_of_players_in_the_first_sample(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.05)
    assert start_prior(problem, observation) is None
    assert start_prior(problem, missing(observation, (3, 0), (-1, 1))) is None
    start = start_prior(problem, missing(observation, (0, 1)))
    assert np.isinf(start.deviation[0]).all()
    assert np.isfinite(start.deviation[1]).all()


def test_the_later_a_player_is_seen_the_wider_is_the_prior_of_its_start(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.01)
    late = start_prior(problem, missing(observation, (0, 0)))
    later = start_prior(problem, missing(observation, (0, 0), (1, 0), (2, 0)))
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
    start = start_prior(problem, missing(Observation(y), (0, 0)))
    steps = len(y) - 1
    speed = np.linalg.norm(y[-1, 1, :2] - y[0, 1, :2]) / steps / problem.game.dt
    assert start.deviation[0, 3] == pytest.approx(speed / 2)
    assert start.deviation[0, :2] == pytest.approx(speed * problem.game.dt / 2)
    assert start.deviation[0, 2] == 0.5


def test_players_of_which_no_sample_is_complete_do_not_count(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.05)
    y = observation.y.copy()
    y[:, 1, 2] = np.nan
    start = start_prior(problem, missing(Observation(y), (0, 0)))
    assert np.isfinite(start.deviation[0]).all()


def test_it_is_a_factor_of_the_posterior(seen) -> None:
    problem, (observation,), _ = seen(sigma=0.05)
    gappy, rng = missing(observation, (0, 1)), np.random.default_rng(0)
    start = start_prior(problem, gappy)
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

"""The particle filter: posteriors with known values, lost particles, small games."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, multivariate_t, norm

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.particle import (
    Particle,
    _Proposal,
    effective_sample_size,
    filter_particles,
    widening,
)
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.belief import Gaussian, LostError
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.forward_model import (
    SolvedGame,
    expected_samples,
    play_batch,
    scaled_samples,
)
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.model.unknowns import Parameters
from olne_bench.games.model.weight_prior import FLAT
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import solve_olne

COUNT = 2000


class Mapped:
    """Games whose expected measurements are a function of points."""

    def __init__(self, expected):
        self.expected = expected

    def tilt(self, points):
        return np.zeros(len(points))

    def tangent(self, point):
        steps = 1e-6 * np.eye(len(point))
        ahead, behind = self.expected(point + steps), self.expected(point - steps)
        slopes = np.moveaxis((ahead - behind) / 2e-6, 0, -1)
        known = np.isfinite(slopes).all()
        return (self.expected(point[None])[0], slopes) if known else None


def last_cloud(prior, expected, samples, sigma, count=COUNT, seed=0, most_draws=10):
    clouds = filter_particles(
        prior,
        Mapped(expected),
        samples,
        sigma,
        count=count,
        most_draws=most_draws,
        rng=np.random.default_rng(seed),
    )
    return list(clouds)[-1]


def moments(cloud):
    mean = cloud.shares @ cloud.points
    return mean, np.cov(cloud.points, rowvar=False, aweights=cloud.shares, ddof=0)


def assert_same_moments(cloud, mean, deviation):
    """Within four standard errors of M/2 independent draws, the least effective sample size.

    Those are, in standard deviations, sqrt(2/M) for a mean and sqrt(1/M) for a deviation.
    """
    own_mean, own_covariance = moments(cloud)
    own_deviation = np.sqrt(np.diag(np.atleast_2d(own_covariance)))
    np.testing.assert_array_less(np.abs(own_mean - mean) / deviation, 4 * np.sqrt(2 / COUNT))
    np.testing.assert_array_less(np.abs(own_deviation / deviation - 1), 4 * np.sqrt(1 / COUNT))


def grid_moments(grid, log_density):
    density = np.exp(log_density - log_density.max())
    density /= density.sum()
    mean = density @ grid
    return mean, np.sqrt(density @ (grid - mean) ** 2)


@pytest.fixture(scope="module")
def one_ratio():
    """Two players with two preferences each; one ratio of the first player's is unknown."""
    scenario = get_scenario("random", 1, num_players=2)
    players = tuple(
        Player(player.preferences[:2], (*player.task, *player.preferences[2:]))
        for player in scenario.game.players
    )
    game = Game(players, scenario.game.dynamics, horizon=12, dt=2 * scenario.game.dt)
    weights = np.array([[0.3, 0.7], [0.6, 0.4]])
    problem = Problem(game, VIEWS["full"], sigma=0.05)
    truth = solve_olne(game, weights, scenario.initial_state)
    noise = problem.sigma * np.random.default_rng(3).standard_normal(truth.states.shape)
    y = observe(problem.view, game.dynamics, truth.states + noise)
    start = SolvedGame(Root(truth.states, truth.controls, truth.costates, 0.0), weights)

    chart = NormalChart(1, 2, problem.weight_floor, FLAT, Parameters(((),)))

    def expected(points):
        rows = np.repeat(weights[None], len(points), axis=0)
        rows[:, :1] = chart.weights(points)
        batch = play_batch(problem, start, rows, scenario.initial_state)
        samples = expected_samples(problem, batch.states)
        samples[~batch.converged] = np.nan
        return samples

    return expected, scaled_samples(problem, y), problem.sigma


@pytest.mark.parametrize("seed", range(3))
def test_one_unknown_ratio_has_the_posterior_of_a_grid(one_ratio, seed):
    expected, samples, sigma = one_ratio
    grid = np.linspace(-6, 6, 1201)
    errors = ((expected(grid[:, None]) - samples) ** 2).sum(axis=(1, 2)) / sigma**2
    assert np.isfinite(errors).all()
    mean, deviation = grid_moments(grid, norm.logpdf(grid, 0, 1.5) - errors / 2)
    assert deviation < 0.5 * 1.5  # the data say something
    prior = Gaussian(np.zeros(1), np.array([[1.5**2]]))
    assert_same_moments(last_cloud(prior, expected, samples, sigma, seed=seed), mean, deviation)


def test_a_bent_posterior_is_that_of_a_grid():
    samples = np.array([[0.3, np.nan], [np.nan, np.nan], [0.2, 0.9]])

    def expected(points):
        return np.stack([points**2, points, np.sin(2 * points)], axis=1) * np.ones(2)

    grid = np.linspace(-5, 5, 4001)
    errors = np.nansum((expected(grid[:, None]) - samples) ** 2, axis=(1, 2)) / 0.3**2
    mean, deviation = grid_moments(grid, norm.logpdf(grid) - errors / 2)
    prior = Gaussian(np.zeros(1), np.eye(1))
    assert_same_moments(last_cloud(prior, expected, samples, 0.3), mean, deviation)


def test_points_without_a_game_have_no_density():
    samples = np.zeros((2, 1))

    def expected(points):
        return np.repeat(np.where(points > 0.2, points, np.nan)[:, None], 2, axis=1)

    grid = np.linspace(0.2, 5, 4001)
    mean, deviation = grid_moments(grid, norm.logpdf(grid) - grid**2)
    cloud = last_cloud(Gaussian(np.zeros(1), np.eye(1)), expected, samples, 1.0)
    assert cloud.points[cloud.shares > 0].min() > 0.2
    assert_same_moments(cloud, mean, deviation)


def test_a_linear_problem_has_the_posterior_of_a_kalman_filter():
    rng = np.random.default_rng(4)
    factor = rng.standard_normal((5, 5))
    prior = Gaussian(rng.standard_normal(5), factor @ factor.T + np.eye(5))
    matrices = rng.standard_normal((12, 3, 5))
    samples = matrices @ rng.standard_normal(5) + 0.1 * rng.standard_normal((12, 3))
    cloud = last_cloud(prior, lambda p: np.einsum("tdn,bn->btd", matrices, p), samples, 0.1)
    precision, pull = np.linalg.inv(prior.covariance), np.linalg.solve(prior.covariance, prior.mean)
    for matrix, sample in zip(matrices, samples, strict=True):
        precision, pull = precision + 100 * matrix.T @ matrix, pull + 100 * matrix.T @ sample
    mean, covariance = np.linalg.solve(precision, pull), np.linalg.inv(precision)
    assert cloud.effective >= COUNT / 2 - 1
    assert_same_moments(cloud, mean, np.sqrt(np.diag(covariance)))


@pytest.mark.parametrize("degrees", [3.0, np.inf])
def test_proposals_are_those_of_scipy(degrees):
    rng = np.random.default_rng(0)
    factor = rng.standard_normal((4, 4))
    around = Gaussian(rng.standard_normal(4), factor @ factor.T + np.eye(4))
    proposal, points = _Proposal(around, degrees), 3 * rng.standard_normal((20, 4))
    known = (
        multivariate_t(around.mean, around.covariance, df=degrees)
        if np.isfinite(degrees)
        else multivariate_normal(around.mean, around.covariance)
    )
    np.testing.assert_allclose(proposal.log(points), known.logpdf(points))
    draws = proposal.draw(200_000, rng)
    inside = known.logpdf(draws) > known.logpdf(points[0])
    expected = known.logpdf(known.rvs(200_000, random_state=rng)) > known.logpdf(points[0])
    assert abs(inside.mean() - expected.mean()) < 4 * np.sqrt(0.5 / 200_000)


def test_effective_sample_size():
    assert effective_sample_size(np.full(7, -1e4)) == pytest.approx(7)
    assert effective_sample_size(np.array([0.0, -np.inf, 0.0])) == pytest.approx(2)
    assert effective_sample_size(np.array([0.0, -800.0])) == pytest.approx(1)
    assert effective_sample_size(np.full(3, -np.inf)) == 0


def test_regions_of_few_samples_hold_as_much_as_those_of_many():
    """The mean squared Mahalanobis distance of a new sample is the number of dimensions."""
    rng, size, count = np.random.default_rng(0), 6, 30
    distances = []
    for _ in range(4000):
        samples, new = rng.standard_normal((count, size)), rng.standard_normal(size)
        away = new - samples.mean(axis=0)
        covariance = widening(count, size) * np.cov(samples, rowvar=False)
        distances.append(away @ np.linalg.solve(covariance, away))
    assert np.mean(distances) == pytest.approx(size, rel=0.05)
    assert widening(8.0, 6) is None


def test_too_few_particles_tell_no_covariance(seen):
    problem, (observation,), _ = seen(1, sigma=0.01)
    few = Particle(count=10, most_draws=2)
    found = few.estimate(problem, observation, rng=np.random.default_rng(0), budget=60)
    assert not found.converged
    assert "do not tell the covariance of 6 free weights" in found.message


def test_no_game_at_all_is_the_end():
    prior, samples = Gaussian(np.zeros(1), np.eye(1)), np.zeros((2, 1))
    with pytest.raises(LostError, match="no particle has an equilibrium"):
        last_cloud(prior, lambda p: np.full((len(p), 2, 1), np.nan), samples, 1.0)


def test_particles_that_explain_nothing_are_the_end():
    drawn: list[np.ndarray] = []

    def expected(points):
        """Only the first particles have a game."""
        if len(points) > 2 and not drawn:
            drawn.append(points)
            return points[:, None]
        return np.full((len(points), 1, 1), np.nan)

    prior = Gaussian(np.zeros(1), np.eye(1))
    with pytest.raises(LostError, match=r"effective sample size 1\.\d of 100"):
        last_cloud(prior, expected, np.array([[3.0]]), 0.001, count=100, most_draws=2)


@pytest.mark.parametrize("view", ["full", "partial"])
def test_small_games(seen, view):
    problem, (observation,), weights = seen(1, sigma=0.01, view=view)
    gappy = observation.y.copy()
    gappy[3, 0], gappy[5:7, 1, 0] = np.nan, np.nan
    rng = np.random.default_rng(0)
    result = Particle().estimate(problem, Observation(gappy), rng=rng, budget=120)
    assert result.converged
    online, effective = (
        result.extras[name] for name in ("online_weights", "effective_sample_size")
    )
    assert online.shape == (12, 2, 4)
    assert effective.shape == (12,)
    assert result.extras["least_effective_sample_size"] == np.nanmin(effective) > 45
    assert effective[-1] >= 100
    np.testing.assert_array_equal(online[-1], result.weights)
    np.testing.assert_allclose(online.sum(axis=2), 1)
    deviations = np.sqrt(np.diag(result.covariance)).reshape(weights.shape)
    assert (np.abs(result.weights - weights) < 4 * deviations).all()
    np.testing.assert_allclose(result.covariance @ np.repeat(np.eye(2), 4, axis=1).T, 0, atol=1e-12)
    errors = np.nansum((result.states - gappy if view == "full" else 0) ** 2)
    assert errors < 2 * gappy.size * problem.sigma**2


def test_several_trajectories_tell_more(seen):
    problem, observations, _ = seen(1, sigma=0.02, count=2)
    one, both = (
        Particle(count=100).estimate(problem, some, rng=np.random.default_rng(0), budget=120)
        for some in (observations[:1], observations)
    )
    assert both.converged
    assert both.extras["online_weights"].shape == (24, 2, 4)
    assert np.trace(both.covariance) < np.trace(one.covariance)


def test_time_is_kept(seen):
    problem, (observation,), _ = seen(1, sigma=0.05)
    result = Particle().estimate(problem, observation, rng=np.random.default_rng(0), budget=0.0)
    assert not result.converged
    assert result.message == "time limit reached"


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"count": 1}, "count must be an integer of 2 to"),
        ({"spread": 0.0}, "spread must be a number of"),
        ({"most_draws": 0}, "most_draws must be an integer of 1 to"),
    ],
)
def test_parameters_out_of_range_are_refused(parameters, message):
    with pytest.raises(ValueError, match=message):
        Particle(**parameters)


def test_a_proposal_without_variance_in_a_direction_is_flat_there() -> None:
    rng = np.random.default_rng(0)
    directions = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    variances = np.array([-1e-17, 1e-3, 0.1, 1.0])  # rounding made one negative
    covariance = directions @ np.diag(variances) @ directions.T
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(covariance)
    proposal = _Proposal(Gaussian(np.ones(4), covariance), np.inf)
    points = proposal.draw(4000, rng)
    assert np.isfinite(proposal.log(points)).all()
    np.testing.assert_allclose(np.cov(points, rowvar=False), covariance, atol=0.08)
    assert np.abs((points - 1) @ directions[:, 0]).max() < 1e-5

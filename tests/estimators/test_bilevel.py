"""The bilevel method: exact gradients, and the joint method's optimum."""

import numpy as np
import pytest

from olne_bench.estimators import bilevel
from olne_bench.estimators.bilevel import Bilevel, OuterResiduals
from olne_bench.estimators.forward_model import first_games
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.simplex import RatioChart

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(("seed", "players"), [(1, 2), (2, 2), (3, 3), (5, 3)])
@pytest.mark.parametrize("view", ["full", "partial"])
def test_gradients_are_those_of_finite_differences(seen, seed, players, view):
    problem, observations, _ = seen(seed, sigma=0.01, view=view, players=players)
    game = first_games(problem, observations[0])[0]
    chart = RatioChart(game.weights, problem.weight_floor)
    residuals = OuterResiduals(problem, tuple(observations), (game,), chart)
    point = residuals.unknowns((game,))
    jacobian = residuals.jacobian(point)
    step = 1e-5
    for k, direction in enumerate(np.eye(point.size)):
        ahead, behind = (residuals.values(point + s * step * direction) for s in (1, -1))
        numeric = (ahead - behind) / (2 * step)
        scale = max(1.0, np.abs(numeric).max())
        np.testing.assert_allclose(jacobian[:, k] / scale, numeric / scale, atol=1e-6)


def test_gradients_of_several_trajectories_are_blocks(seen):
    problem, observations, _ = seen(1, sigma=0.01, count=2)
    games = tuple(first_games(problem, one)[0] for one in observations)
    chart = RatioChart(games[0].weights, problem.weight_floor)
    residuals = OuterResiduals(problem, tuple(observations), games, chart)
    point = residuals.unknowns(games)
    jacobian, rows = residuals.jacobian(point), observations[0].y.size
    assert not jacobian[:rows, -8:].any()
    assert not jacobian[rows:, chart.size : chart.size + 8].any()
    direction = np.random.default_rng(0).standard_normal(point.size)
    ahead, behind = (residuals.values(point + s * 1e-6 * direction) for s in (1, -1))
    np.testing.assert_allclose(jacobian @ direction, (ahead - behind) / 2e-6, atol=1e-5)


@pytest.mark.parametrize("seed", [1, 2, 4])
@pytest.mark.parametrize("view", ["full", "partial"])
def test_the_optimum_is_that_of_the_joint_method(seen, seed, view):
    problem, (observation,), _ = seen(seed, sigma=0.02, view=view)
    bilevel = Bilevel().estimate(problem, observation, rng=RNG, budget=60)
    joint = KktConstrained().estimate(problem, observation, rng=RNG, budget=60)
    assert bilevel.converged
    assert joint.converged
    assert bilevel.extras["objective"] == pytest.approx(joint.extras["objective"], abs=1e-6)
    np.testing.assert_allclose(bilevel.covariance, joint.covariance, rtol=1e-2, atol=1e-6)


def test_time_is_kept(seen):
    problem, (observation,), _ = seen(1, sigma=0.1)
    result = Bilevel().estimate(problem, observation, rng=RNG, budget=0.0)
    assert not result.converged
    assert result.message == "time limit reached"


def test_several_trajectories_tell_more(seen):
    problem, observations, _ = seen(1, sigma=0.01, count=3)
    one = Bilevel().estimate(problem, observations[0], rng=RNG, budget=60)
    all_of_them = Bilevel().estimate(problem, observations, rng=RNG, budget=60)
    assert np.trace(all_of_them.covariance) < 0.7 * np.trace(one.covariance)


def test_a_search_that_equilibria_end_is_no_optimum(seen, monkeypatch):
    problem, (observation,), _ = seen(1, sigma=0.02)
    play, calls = OuterResiduals._play, []

    def play_once(self, unknowns):
        calls.append(unknowns)
        first = np.array_equal(unknowns, calls[0])
        return play(self, unknowns) if first else None

    monkeypatch.setattr(OuterResiduals, "_play", play_once)
    result = Bilevel(starts=1).estimate(problem, observation, rng=RNG, budget=60)
    assert not result.converged
    assert result.message == "no equilibrium in the direction of descent"


def test_a_trajectory_with_fewer_starts_repeats_its_last():
    starts = [["a"], ["b", "c", "d"], ["e", "f"]]
    combinations = [("a", "b", "e"), ("a", "c", "f"), ("a", "d", "f")]
    assert bilevel._combinations(starts, 5) == combinations
    assert bilevel._combinations(starts, 2) == combinations[:2]

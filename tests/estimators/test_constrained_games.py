"""Estimators on games with hard constraints, with and without knowing them."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.ignorant import Ignorant
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.kkt_residual import KktResidual
from olne_bench.estimators.maxent_residual import MaxentResidual
from olne_bench.estimators.protocol import Estimator, Observation, Problem
from olne_bench.estimators.ukf import Ukf
from olne_bench.games.model.constraints import Distance
from olne_bench.games.model.costs import ControlEffort, FinalGoal, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.olne import solve_olne

WEIGHTS = np.array([[0.2, 0.3, 0.5], [0.45, 0.3, 0.25]])
START = np.array([[-1.0, 0.0, 0.1, 0.3], [0.1, -1.0, 1.5, 0.25]])


@pytest.fixture(scope="module")
def crossing() -> tuple[Problem, np.ndarray]:
    """Two vehicles that cross and have to keep 0.8 m; the true motion (T, N, n)."""
    likes = (
        StateDeviation("speed"),
        ControlEffort("acceleration", 10.0),
        ControlEffort("yaw_rate"),
    )
    players = tuple(
        Player(likes, (FinalGoal(goal, scale=10.0),)) for goal in ((1.0, 0.0), (0.0, 1.0))
    )
    game = Game(players, UNICYCLE, 12, 0.4, (Distance((0, 1), 0.8),))
    truth = solve_olne(game, WEIGHTS, START)
    assert truth.certificate.passed
    assert truth.active.sum() >= 2
    return Problem(game, VIEWS["full"]), truth.states


def _error(
    estimator: Estimator, problem: Problem, states: np.ndarray, view: str, sigma: float = 0.0
) -> float:
    problem = replace(problem, view=VIEWS[view], sigma=sigma, noise_scale=())
    y = observe(problem.view, UNICYCLE, states)
    y = y + sigma * np.random.default_rng(0).standard_normal(y.shape)
    found = estimator.estimate(problem, Observation(y), rng=np.random.default_rng(0), budget=60.0)
    assert found.converged, found.message
    return float(np.abs(found.weights - WEIGHTS).max())


@pytest.mark.parametrize("view", ["full", "partial"])
@pytest.mark.parametrize("estimator", [KktConstrained(), Bilevel()])
def test_exact_motion_returns_the_weights(crossing, estimator, view) -> None:
    assert _error(estimator, *crossing, view) < 1e-5


def test_filters_come_close(crossing) -> None:
    assert _error(Ukf(), *crossing, "full", sigma=1e-4) < 0.05


@pytest.mark.parametrize("of", ["kkt_constrained", "bilevel"])
def test_ignorance_takes_forces_for_preferences(crossing, of) -> None:
    assert _error(Ignorant(of), *crossing, "full") > 0.1


@pytest.mark.parametrize("estimator", [KktResidual(), MaxentResidual()])
def test_residual_methods_decline(crossing, estimator) -> None:
    problem, _ = crossing
    assert "residuals know no constraints" in estimator.supports(problem)
    assert estimator.supports(replace(problem, game=replace(problem.game, constraints=()))) is None
    assert Ignorant(estimator.name).supports(problem) is None


def test_ipopt_and_several_trajectories_decline(crossing) -> None:
    problem, states = crossing
    assert "need the structured solver" in (KktConstrained("ipopt").supports(problem) or "")
    assert KktConstrained().supports(problem) is None
    reason = "takes one trajectory at a time where a game has constraints"
    assert KktConstrained("ipopt").supports_several(problem) == reason
    free = replace(problem, game=replace(problem.game, constraints=()))
    assert KktConstrained("ipopt").supports_several(free) is None
    twice = [Observation(states)] * 2
    with pytest.raises(ValueError, match="knows no constraints"):
        KktConstrained("ipopt").estimate(problem, twice, rng=np.random.default_rng(0), budget=10.0)


def test_a_motion_seen_twice_says_the_same_as_one(crossing) -> None:
    problem, states = crossing
    given = {"rng": np.random.default_rng(0), "budget": 10.0}
    assert KktConstrained().supports_several(problem) is None
    one = KktConstrained().estimate(problem, Observation(states), **given)
    two = KktConstrained().estimate(problem, [Observation(states)] * 2, **given)
    np.testing.assert_allclose(two.weights, one.weights, atol=1e-5)


def test_an_unknown_estimator_is_refused() -> None:
    with pytest.raises(ValueError, match="must be a built-in estimator, got 'nobody'"):
        Ignorant("nobody")

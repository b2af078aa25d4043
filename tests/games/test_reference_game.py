"""The fast game of cars along references finds local Nash equilibria."""

from dataclasses import replace

import numpy as np
import pytest

from olne_bench.games.dynamics import rollout
from olne_bench.games.reference_game import FAR_AWAY, ReferenceGame, Situation

STEPS = 6


@pytest.fixture(scope="module")
def game() -> ReferenceGame:
    return ReferenceGame(steps=STEPS, dt=0.4, max_players=3, num_others=1)


def situation(count: int) -> Situation:
    initial = np.array([[0, 0, 0, 25.0], [18, 4, 0, 20], [-16, 4, 0, 24]])[:count]
    lanes, speeds = np.array([4.0, 4.0, 0.0])[:count], np.array([25.0, 20.0, 26.0])[:count]
    references = np.zeros((count, STEPS, 4))
    references[..., 1], references[..., 3] = lanes[:, None], speeds[:, None]
    others = np.full((count, 1, STEPS, 2), FAR_AWAY)
    return Situation(initial, np.full((count, 5), 1.0), references, others)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_solution_is_stationary_and_convex(game, count):
    plan = game.solve(situation(count), np.zeros((STEPS, count, 2)), tolerance=1e-9)
    assert plan.converged and plan.residual < 1e-9
    played = rollout(game.dynamics, plan.states[0], plan.controls, game.dt)
    np.testing.assert_allclose(plan.states, played, atol=1e-12)


def test_newton_matrix_is_the_derivative_of_the_gradients(game):
    """Central differences, away from the solution, other players' influence included."""
    here = situation(3)
    rng = np.random.default_rng(0)
    unknowns = 0.01 * rng.standard_normal((3, STEPS, 2))
    direction = rng.standard_normal(unknowns.shape)
    ahead, behind = (
        game._evaluate(here, unknowns + step * direction).gradients for step in (1e-6, -1e-6)
    )
    change = (ahead - behind) / 2e-6
    at = game._evaluate(here, unknowns)
    assert np.linalg.eigvalsh(at.own_hessians).min() > 0  # else the matrix is regularised
    np.testing.assert_allclose(
        game._newton_step(replace(at, gradients=change)), -direction.ravel(), rtol=1e-4, atol=1e-5
    )


def test_no_player_gains_by_a_small_deviation(game):
    """Costs by quadrature of gradients along the deviation: no private cost function needed."""
    here = situation(3)
    plan = game.solve(here, np.zeros((STEPS, 3, 2)), tolerance=1e-10)
    rng = np.random.default_rng(1)
    for player in range(3):
        offset = np.zeros((3, STEPS, 2))
        offset[player] = 1e-3 * rng.standard_normal((STEPS, 2))
        nodes, weights = np.polynomial.legendre.leggauss(5)
        start = plan.controls.swapaxes(0, 1)
        change = (
            sum(
                w / 2 * game._evaluate(here, start + (x + 1) / 2 * offset).gradients[player]
                for x, w in zip(nodes, weights, strict=True)
            )
            @ offset[player].ravel()
        )
        assert change > 0


def test_predicted_others_are_avoided(game):
    free = situation(1)
    start = np.zeros((STEPS, 1, 2))
    straight = game.solve(free, start).states[:, 0]
    beside = straight[1:, :2] + [0.0, 2.5]  # somebody who drives along on the right
    aside = game.solve(replace(free, others=beside[None, None]), start).states[:, 0]
    assert aside[-1, 1] < straight[-1, 1] - 0.1


def test_unsolvable_situations_are_reported(game):
    broken = replace(situation(2), initial_state=np.full((2, 4), np.nan))
    assert not game.solve(broken, np.zeros((STEPS, 2, 2))).converged

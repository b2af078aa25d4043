"""Feedback equilibria against Riccati recursions written out anew, and against open-loop ones."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest

import olne_bench as ob
from olne_bench.games.model.costs import ControlEffort, Stage, StateDeviation
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR
from olne_bench.games.model.game import Game, Player
from olne_bench.games.solve.feedback import certify_feedback, solve_feedback


@dataclass(frozen=True)
class Gap:
    """Squared distance to the next player, less a wish."""

    wish: float
    name: str = "gap"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        other = (stage.player + 1) % len(stage.states)
        return ca.sumsqr(stage.position(stage.player) - stage.position(other) - self.wish)

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return 2 * self.running_cost(stage)


def linear(count: int, *, coupled: bool = True) -> Game:
    effort = tuple(ControlEffort(name, scale=4.0) for name in DOUBLE_INTEGRATOR.control_names)
    players = tuple(
        Player((Gap(1.0 + k) if coupled else StateDeviation("py", 2.0, 1.0), *effort))
        for k in range(count)
    )
    return Game(players, DOUBLE_INTEGRATOR, horizon=8, dt=0.5)


def parts(game: Game, weights: np.ndarray):
    """A, B_i, and each player's Q, q, R of x'Qx/2 + q'x + u'Ru/2, by differences of its cost."""
    count, n, m = game.num_players, 4, 2
    zero = [ca.DM.zeros(n)] * count
    following = (
        DOUBLE_INTEGRATOR.step(ca.DM(row[:n]), ca.DM(row[n:]), game.dt) for row in np.eye(n + m)
    )
    A, B = np.split(np.hstack([np.array(row) for row in following]), [n], axis=1)
    x, u = ca.SX.sym("x", count * n), ca.SX.sym("u", m)
    found = []
    for i, player in enumerate(game.players):
        stage = Stage(i, tuple(ca.vertsplit(x, n)), u, game.dynamics, game.dt)
        row = ca.DM(weights[i])
        pair = []
        for cost in (player.running_cost(stage, row), player.final_cost(stage, row)):
            H, g = ca.hessian(cost, ca.vertcat(x, u))
            values = ca.Function("h", [x, u], [H, g])(ca.vertcat(*zero), 0)
            pair.append([np.array(value) for value in values])
        found.append(pair)
    return A, B, found


def riccati(game: Game, weights: np.ndarray, start: np.ndarray) -> np.ndarray:
    """States (T, N*n) of the feedback Nash equilibrium of an LQ game (Basar and Olsder, ch. 6)."""
    count, n, m = game.num_players, 4, 2
    a, b, costs = parts(game, weights)
    A = np.kron(np.eye(count), a)
    Bs = [np.kron(np.eye(count)[:, [i]], b) for i in range(count)]
    size = count * n
    Z = [pair[1][0][:size, :size] for pair in costs]
    zeta = [pair[1][1][:size, 0] for pair in costs]
    policies = []
    for _ in range(game.horizon - 1):
        R = [pair[0][0][size:, size:] for pair in costs]
        S = np.block(
            [
                [Bs[i].T @ Z[i] @ Bs[j] + (R[i] if i == j else 0) for j in range(count)]
                for i in range(count)
            ]
        )
        P = np.linalg.solve(S, np.vstack([Bs[i].T @ Z[i] @ A for i in range(count)]))
        alpha = np.linalg.solve(S, np.hstack([Bs[i].T @ zeta[i] for i in range(count)]))
        F, beta = A - np.hstack(Bs) @ P, -np.hstack(Bs) @ alpha
        for i in range(count):
            own = slice(i * m, (i + 1) * m)
            Q, q = costs[i][0][0][:size, :size], costs[i][0][1][:size, 0]
            zeta[i] = q + F.T @ (zeta[i] + Z[i] @ beta) + P[own].T @ R[i] @ alpha[own]
            Z[i] = Q + F.T @ Z[i] @ F + P[own].T @ R[i] @ P[own]
        policies.append((P, alpha))
    states = [start]
    for P, alpha in reversed(policies):
        states.append(A @ states[-1] - np.hstack(Bs) @ (P @ states[-1] + alpha))
    return np.array(states)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_lq_games_have_the_motion_of_the_coupled_riccati_recursion(count):
    game, rng = linear(count), np.random.default_rng(count)
    if count == 1:
        game = linear(1, coupled=False)  # LQR
    weights, start = rng.dirichlet(np.ones(3), count), rng.normal(size=(count, 4))
    found = solve_feedback(game, weights, start, initial_controls=np.zeros(game.control_shape))
    assert found.converged and found.iterations == 2
    expected = riccati(game, game.check_weights(weights), start.ravel())
    np.testing.assert_allclose(found.states.reshape(8, -1), expected, atol=1e-10)


def test_uncoupled_players_have_the_plans_of_the_open_loop():
    game, weights = linear(2, coupled=False), np.array([[0.5, 0.3, 0.2], [0.2, 0.2, 0.6]])
    start = np.random.default_rng(0).normal(size=(2, 4))
    plans = ob.solve_olne(game, weights, start)
    found = solve_feedback(game, weights, start)
    np.testing.assert_allclose(found.states, plans.states, atol=1e-8)


@pytest.fixture(scope="module")
def crossing():
    return ob.scenario("intersection", seed=0, num_players=3, weights="temperaments")


@pytest.fixture(scope="module")
def found(crossing):
    return solve_feedback(crossing.game, crossing.weights, crossing.initial_state)


def test_nobody_gains_by_another_strategy_but_at_the_open_loop_they_do(crossing, found):
    game, weights = crossing.game, crossing.weights
    assert found.converged and found.least_curvature > 0
    assert certify_feedback(game, found, weights, starts=2).max() < 1e-12
    plans = ob.solve_olne(game, weights, crossing.initial_state)
    assert 1e-4 < np.abs(found.states - plans.states).max() < 1
    as_plans = replace(found, states=plans.states, controls=plans.controls)
    as_plans = replace(as_plans, costs=plans.certificate.costs)
    assert certify_feedback(game, as_plans, weights, starts=2).max() > 1e-7


def test_strategies_answer_a_disturbance_and_scales_and_order_of_players_do_not_matter(
    crossing, found
):
    game, weights, start = crossing.game, crossing.weights, crossing.initial_state
    away = found.states[3] + 0.1
    assert np.abs(found.action(3, found.states[3]) - found.controls[3]).max() == 0
    assert np.abs(found.action(3, away) - found.controls[3]).max() > 1e-3
    scaled = solve_feedback(game, 7 * weights, start)
    np.testing.assert_allclose(scaled.states, found.states, atol=1e-9)
    order = [2, 0, 1]
    turned = replace(game, players=tuple(game.players[i] for i in order))
    other = solve_feedback(turned, weights[order], start[order])
    np.testing.assert_allclose(other.states, found.states[:, order], atol=1e-6)
    np.testing.assert_allclose(other.costs, found.costs[order], rtol=1e-9)


def test_wrong_use_is_refused():
    game = linear(2)
    with pytest.raises(ValueError, match="weights have the shape"):
        solve_feedback(game, np.ones((3, 3)), np.zeros((2, 4)))
    unknown, (problem, _) = ob.scenario("unknown_goals"), ob.observe("unknown_goals")
    with pytest.raises(ValueError, match=r"numbers are known: game\.known"):
        solve_feedback(problem.game, unknown.weights, unknown.initial_state)
    kept = ob.scenario("two_player").game
    kept = replace(kept, constraints=(ob.constraints.Distance((0, 1), 0.5),))
    with pytest.raises(ValueError, match="a feedback equilibrium"):
        solve_feedback(kept, np.ones((2, kept.num_weights)), np.zeros((2, 4)))

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Stage, StateDeviation
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR, rollout
from olne_bench.games.model.game import Game, Player
from olne_bench.games.solve.best_response import Responses, best_responses
from olne_bench.games.solve.constrained_response import constrained_response
from olne_bench.games.solve.kkt import consistent_costates, kkt_residual_norm, kkt_system
from olne_bench.games.solve.newton import newton_root
from olne_bench.games.solve.olne import Equilibrium, certify, solve_olne

Crossing = tuple[Game, np.ndarray, np.ndarray]
GoalGame = Callable[..., Game]
PAPER = ("two_player", "highway_overtaking")


def reference(name: str) -> dict[str, Any]:
    return json.loads((Path(__file__).parent / "reference" / f"{name}.json").read_text())


class TestReference:
    """The published experiments' equilibria, from a cold start."""

    @pytest.mark.parametrize("name", PAPER)
    def test_reproduced(
        self, name: str, scenario_equilibrium: Callable[[str], Equilibrium]
    ) -> None:
        expected, found = reference(name), scenario_equilibrium(name)
        np.testing.assert_allclose(found.states, expected["states"], rtol=0, atol=1e-6)
        np.testing.assert_allclose(found.controls, expected["controls"], rtol=0, atol=1e-6)
        assert found.residual < 1e-9
        assert found.certificate.passed

    @pytest.mark.parametrize("name", PAPER)
    def test_residual_is_what_it_says(
        self, name: str, scenario_equilibrium: Callable[[str], Equilibrium]
    ) -> None:
        scenario, found = get_scenario(name), scenario_equilibrium(name)
        residual = kkt_residual_norm(
            scenario.game, found.states, found.controls, found.costates, scenario.weights
        )
        assert residual == pytest.approx(found.residual, abs=1e-12)

    @pytest.mark.parametrize("name", PAPER)
    def test_same_answer_twice(
        self, name: str, scenario_equilibrium: Callable[[str], Equilibrium]
    ) -> None:
        scenario, found = get_scenario(name), scenario_equilibrium(name)
        again = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
        np.testing.assert_array_equal(again.states, found.states)


@dataclass(frozen=True)
class Formation:
    """``|p_i - p_j - offset|^2`` to the next player: a quadratic coupling, defined by a user."""

    offset: tuple[float, float]
    name: str = "formation"

    def running_cost(self, stage: Stage) -> ca.SX | float:
        other = (stage.player + 1) % len(stage.states)
        return ca.sumsqr(stage.position(stage.player) - stage.position(other) - ca.DM(self.offset))

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.running_cost(stage)


class TestLinearQuadratic:
    """A game whose open-loop Nash equilibrium is one linear system (Basar and Olsder, Ch. 6)."""

    HORIZON, DT = 12, 0.3
    OFFSETS = ((-1.0, 0.5), (0.7, -0.2), (0.1, 0.9))
    GOALS = ((2.0, 1.0), (-1.0, 3.0), (0.5, -2.0))
    TARGETS = (0.5, -0.2, 0.1)
    WEIGHTS = np.array([[0.3, 0.2, 0.4, 0.1], [0.1, 0.4, 0.2, 0.3], [0.25, 0.25, 0.3, 0.2]])
    INITIAL_STATE = np.array([[0, 0, 1, 0.2], [1, -1, 0, 0.5], [-1, 0.5, -0.3, 0.1]])

    def game(self, count: int) -> Game:
        players = [
            Player(
                preferences=(
                    Formation(self.OFFSETS[i]),
                    StateDeviation("vx", target=self.TARGETS[i]),
                    ControlEffort("ax", scale=4.0),
                    ControlEffort("ay", scale=7.0),
                ),
                task=(FinalGoal(self.GOALS[i], scale=5.0),),
            )
            for i in range(count)
        ]
        return Game(tuple(players), DOUBLE_INTEGRATOR, self.HORIZON, self.DT)

    def analytic(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States, controls and costates by the coupled linear conditions, in NumPy alone.

        Every player's states are affine in its controls, x^i = free^i + S u^i, so its
        stationarity S' grad_x J^i + grad_u J^i = 0 is linear in all players' controls.
        """
        T, dt = self.HORIZON, self.DT
        A = np.eye(4) + dt * np.eye(4, k=2)
        B = dt * np.eye(4)[:, 2:]
        S = np.zeros((T, 4, T - 1, 2))
        for t in range(1, T):
            for s in range(t):
                S[t, :, s] = np.linalg.matrix_power(A, t - 1 - s) @ B
        S = S.reshape(T * 4, (T - 1) * 2)
        weights = self.WEIGHTS[:count]
        free = [
            np.concatenate([np.linalg.matrix_power(A, t) @ x for t in range(T)])
            for x in self.INITIAL_STATE[:count]
        ]
        position, speed = np.diag([1.0, 1, 0, 0]), np.diag([0, 0, 1.0, 0])
        last = np.zeros((T, T))
        last[-1, -1] = 1

        size = (T - 1) * 2
        matrix, vector = np.zeros((count * size, count * size)), np.zeros(count * size)
        terms = []
        for i in range(count):
            other = (i + 1) % count
            formation, velocity, effort_x, effort_y = weights[i]
            own = 2 * (
                np.kron(np.eye(T), formation * position + velocity * speed)
                + np.kron(last, weights[i].mean() * 5.0 * position)
            )
            across = -2 * np.kron(np.eye(T), formation * position)
            constant = -2 * (
                np.tile(
                    [*(formation * np.array(self.OFFSETS[i])), velocity * self.TARGETS[i], 0], T
                )
                + np.kron(last[-1], [*(weights[i].mean() * 5.0 * np.array(self.GOALS[i])), 0, 0])
            )
            effort = 2 * dt**2 * np.kron(np.eye(T - 1), np.diag([4 * effort_x, 7 * effort_y]))
            rows = slice(i * size, (i + 1) * size)
            columns = slice(other * size, (other + 1) * size)
            matrix[rows, rows] += S.T @ own @ S + effort
            matrix[rows, columns] += S.T @ across @ S
            vector[rows] = -S.T @ (own @ free[i] + across @ free[other] + constant)
            terms.append((own, across, constant, other))
        u = np.linalg.solve(matrix, vector).reshape(count, size)
        x = [free[i] + S @ u[i] for i in range(count)]

        costates = np.zeros((T - 1, count, 4))
        for i, (own, across, constant, other) in enumerate(terms):
            gradient = (own @ x[i] + across @ x[other] + constant).reshape(T, 4)
            following = np.zeros(4)
            for t in reversed(range(T - 1)):  # the adjoint recursion
                following = A.T @ following - gradient[t + 1]
                costates[t, i] = following
        states = np.stack([own_states.reshape(T, 4) for own_states in x], axis=1)
        return states, u.reshape(count, T - 1, 2).transpose(1, 0, 2), costates

    @pytest.mark.parametrize("count", [2, 3])
    def test_reproduced(self, count: int) -> None:
        states, controls, costates = self.analytic(count)
        found = solve_olne(self.game(count), self.WEIGHTS[:count], self.INITIAL_STATE[:count])
        assert found.certificate.passed
        np.testing.assert_allclose(found.states, states, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.controls, controls, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.costates, costates, rtol=0, atol=1e-9)

    def test_analytic_solution_is_certified(self) -> None:
        game = self.game(2)
        states, controls, costates = self.analytic(2)
        root = newton_root(game, states, controls, costates, self.WEIGHTS[:2], max_iterations=0)
        assert root.residual < 1e-11
        assert certify(game, root, self.WEIGHTS[:2]).passed


class TestProperties:
    @given(st.lists(st.floats(0.01, 100), min_size=3, max_size=3))
    @settings(max_examples=4)
    def test_scale_of_a_players_weights_does_not_matter(
        self, crossing: Crossing, olne: Equilibrium, scales: list[float]
    ) -> None:
        game, weights, initial_state = crossing
        found = solve_olne(game, np.array(scales)[:, None] * weights, initial_state)
        np.testing.assert_allclose(found.states, olne.states, atol=1e-8)

    @pytest.mark.parametrize("order", [(1, 0, 2), (2, 0, 1)])
    def test_renaming_players_renames_the_equilibrium(
        self, crossing: Crossing, olne: Equilibrium, order: tuple[int, ...]
    ) -> None:
        game, weights, initial_state = crossing
        renamed = replace(game, players=tuple(game.players[i] for i in order))
        found = solve_olne(renamed, weights[list(order)], initial_state[list(order)])
        assert found.certificate.passed
        expected = olne.states[:, list(order)]
        np.testing.assert_allclose(found.states, expected, atol=1e-8)

    @given(st.floats(-3, 3), st.floats(-5, 5), st.floats(-5, 5))
    @settings(max_examples=4)
    def test_turning_and_moving_the_world_does_not_matter(
        self,
        crossing: Crossing,
        olne: Equilibrium,
        goal_game: GoalGame,
        angle: float,
        dx: float,
        dy: float,
    ) -> None:
        _, weights, initial_state = crossing
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

        def moved(states: np.ndarray) -> np.ndarray:
            positions = states[..., :2] @ turn.T + [dx, dy]
            return np.concatenate([positions, states[..., 2:3] + angle, states[..., 3:]], axis=-1)

        goals = np.array([[1.0, 0.2], [0.1, 1.0], [-0.9, -0.5]]) @ turn.T + [dx, dy]
        found = solve_olne(goal_game(goals), weights, moved(initial_state))
        assert found.certificate.passed
        np.testing.assert_allclose(found.states, moved(olne.states), atol=1e-7)

    def test_equilibrium_obeys_the_dynamics_and_the_start(
        self, crossing: Crossing, olne: Equilibrium
    ) -> None:
        game, _, initial_state = crossing
        np.testing.assert_array_equal(olne.states[0], initial_state)
        expected = rollout(game.dynamics, initial_state, olne.controls, game.dt)
        np.testing.assert_allclose(olne.states, expected, atol=1e-10)

    def test_nobody_gains_from_random_deviations(
        self, crossing: Crossing, olne: Equilibrium
    ) -> None:
        """The definition (eqn. nash) itself, without any optimiser."""
        game, weights, initial_state = crossing
        found, rng = olne, np.random.default_rng(0)
        function = kkt_system(game).cost_function
        for size in (1e-3, 1e-2, 0.1):
            for i in range(game.num_players):
                controls = found.controls.copy()
                controls[:, i] += size * rng.standard_normal(controls[:, i].shape)
                states = rollout(game.dynamics, initial_state, controls, game.dt)
                costs = np.array(function(states.ravel(), controls.ravel(), weights.ravel()))
                assert costs.ravel()[i] > found.certificate.costs[i]


class TestCertificate:
    def test_perturbed_trajectory_fails(self, crossing: Crossing, olne: Equilibrium) -> None:
        game, weights, initial_state = crossing
        controls = olne.controls + 1e-2
        states = rollout(game.dynamics, initial_state, controls, game.dt)
        # A residual of zero is claimed so that the best responses have to find it out.
        claimed = replace(olne, states=states, controls=controls, residual=0.0)
        certificate = certify(game, claimed, weights)
        assert not certificate.passed
        assert (certificate.gains > 1e-7).all()

    def test_a_response_that_is_lost_certifies_nothing(
        self, crossing: Crossing, olne: Equilibrium, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        game, weights, _ = crossing
        assert certify(game, olne, weights).passed

        def lost(game: Game, player: int, *arguments: np.ndarray) -> Responses:
            found = best_responses(game, player, *arguments)
            return replace(found, converged=found.converged & (player != 0))

        monkeypatch.setattr("olne_bench.games.solve.olne.best_responses", lost)
        assert not certify(game, olne, weights).passed

    def test_gains_are_allowed_relative_to_costs(
        self, crossing: Crossing, olne: Equilibrium
    ) -> None:
        game, weights, initial_state = crossing
        controls = olne.controls + 1e-2
        states = rollout(game.dynamics, initial_state, controls, game.dt)
        claimed = replace(olne, states=states, controls=controls, residual=0.0)
        first = certify(game, claimed, weights)
        largest = (first.gains / (1 + np.abs(first.costs))).max()
        for factor, passed in ((1.01, True), (0.99, False)):
            assert certify(game, claimed, weights, tolerance=factor * largest).passed == passed

    def test_saddle_point_fails(self, goal_game: GoalGame) -> None:
        """Head on, driving straight is a root of G, but everybody gains from swerving."""
        game = goal_game(np.array([[1.0, 0.0], [-1.0, 0.0]]), horizon=12)
        weights = game.check_weights(np.tile([4.0, 1, 1, 1], (2, 1)))
        initial_state = np.array([[-1, 0, 0, 0.2], [1, 0, np.pi, 0.2]])
        controls = np.zeros(game.control_shape)
        states = rollout(game.dynamics, initial_state, controls, game.dt)
        costates = consistent_costates(game, states, controls, weights)
        root = newton_root(game, states, controls, costates, weights)
        assert root.residual < 1e-9
        assert np.abs(root.states[..., 1]).max() < 1e-9
        certificate = certify(game, root, weights)
        assert not certificate.passed
        assert (certificate.gains > 1e-3).all()

        swerving = solve_olne(game, weights, initial_state)
        assert swerving.certificate.passed
        assert np.abs(swerving.states[..., 1]).max() > 0.1

    def test_large_residual_fails(self, crossing: Crossing, olne: Equilibrium) -> None:
        game, weights, _ = crossing
        for residual in (1e-6, np.nan, np.inf):
            claimed = replace(olne, residual=residual)
            assert not certify(game, claimed, weights).passed

    def test_impossible_tolerance_fails(self, crossing: Crossing) -> None:
        found = solve_olne(*crossing, certificate_tolerance=-1e-3)
        assert not found.certificate.passed
        assert found.residual < 1e-9

    def test_game_without_equilibrium_is_not_certified(self) -> None:
        """A lone player paid for running away: the root of G is no minimum."""
        player = Player(
            (StateDeviation("px", scale=-1.0), ControlEffort("ax"), ControlEffort("ay"))
        )
        game = Game((player,), DOUBLE_INTEGRATOR, 6, 0.25)
        found = solve_olne(game, np.ones((1, 3)), np.array([[1.0, 0, 0, 0]]))
        assert not found.certificate.passed


@pytest.mark.parametrize("num_players", [2, 3, 4])
def test_random_family_is_certified(num_players: int) -> None:
    for seed in range(3):
        scenario = get_scenario("random", seed, num_players=num_players)
        found = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
        assert found.certificate.passed
        assert found.residual < 1e-9


@pytest.mark.parametrize(("horizon", "players"), [(2, 1), (2, 2), (3, 1)])
def test_smallest_games(goal_game: GoalGame, horizon: int, players: int) -> None:
    goals = np.array([[1.0, 0.0], [0.0, 1.0]])[:players]
    game = goal_game(goals, horizon=horizon)
    initial_state = np.array([[-1, 0, 0.1, 0.2], [0, -1, 1.5, 0.2]])[:players]
    found = solve_olne(game, np.ones((players, 4)), initial_state)
    assert found.certificate.passed
    assert found.states.shape == game.state_shape
    own = found.controls[:, 0], np.full(4, 0.25)
    response = constrained_response(game, 0, found.states, found.controls, *own)
    np.testing.assert_allclose(response.states, found.states[:, 0], atol=1e-6)


def test_initial_controls_of_a_wrong_shape_are_refused(crossing: Crossing) -> None:
    with pytest.raises(ValueError, match=r"initial_controls have the shape \(2, 2\), expected"):
        solve_olne(*crossing, initial_controls=np.zeros((2, 2)))


def test_start_at_the_equilibrium_stays_there(crossing: Crossing, olne: Equilibrium) -> None:
    found = solve_olne(*crossing, initial_controls=olne.controls)
    np.testing.assert_allclose(found.states, olne.states, atol=1e-9)

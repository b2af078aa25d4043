import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.dynamics import UNICYCLE, rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.kkt import consistent_costates, kkt_residual_norm, kkt_system
from olne_bench.games.solve.olne import Equilibrium

Crossing = tuple[Game, np.ndarray, np.ndarray]


def paper_cost(name: str, states: np.ndarray, controls: np.ndarray, weights: np.ndarray) -> list:
    """Eqn. runexp-cost with the published scales, in plain NumPy."""
    two_player = name == "two_player"
    dt = 0.25 if two_player else 1.0
    goals = [(1, 0), (0, 1)]
    lanes = [0, 0, 1, 1, 1]
    target_speeds = [0, 0] if two_player else [0.3, 0.4, 0.1, 0.1, 0.2]
    costs = []
    for i, (proximity, speed, acceleration, yaw_rate) in enumerate(weights):
        px, _, heading, v = states[:, i].T
        squared = [
            np.sum((states[:, i, :2] - states[:, j, :2]) ** 2, axis=1)
            for j in range(len(weights))
            if j != i
        ]
        cost = proximity * 0.1 * -np.log(np.array(squared) + 0.1).sum()
        cost += speed * np.sum((v - target_speeds[i]) ** 2)
        cost += acceleration * 10 * np.sum((dt * controls[:, i, 1]) ** 2)
        cost += yaw_rate * np.sum((dt * controls[:, i, 0]) ** 2)
        mean = np.mean(weights[i])
        if two_player:
            cost += mean * 100 * np.sum((states[-1, i, :2] - goals[i]) ** 2)
        else:
            cost += mean * np.sum((px - lanes[i]) ** 2)
            cost += mean * 2 * np.sum((heading - np.pi / 2) ** 2)
        costs.append(cost)
    return costs


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking"])
@given(st.integers(0, 2**32))
def test_costs_are_the_papers(name: str, seed: int) -> None:
    game = get_scenario(name).game
    rng = np.random.default_rng(seed)
    states, controls = (rng.standard_normal(s) for s in (game.state_shape, game.control_shape))
    weights = rng.uniform(0.01, 2, (game.num_players, 4))
    function = kkt_system(game).cost_function
    costs = np.array(function(states.ravel(), controls.ravel(), weights.ravel())).ravel()
    np.testing.assert_allclose(costs, paper_cost(name, states, controls, weights), rtol=1e-12)


def test_stationarity_is_the_gradient_of_each_players_own_lagrangian(crossing: Crossing) -> None:
    """Against central differences of the costs: no derivative of the system is taken on trust."""
    game, weights, _ = crossing
    rng = np.random.default_rng(1)
    states, controls = (rng.standard_normal(s) for s in (game.state_shape, game.control_shape))
    costates = rng.standard_normal(states[1:].shape)
    system = kkt_system(game)
    step = ca.Function("f", *_step_of(game))

    def lagrangian(i: int, x: np.ndarray, u: np.ndarray) -> float:
        cost = np.array(system.cost_function(x.ravel(), u.ravel(), weights.ravel())).ravel()[i]
        following = np.array(step(x[:-1, i].T, u[:, i].T)).T
        return cost + np.sum(costates[:, i] * (x[1:, i] - following))

    residual = np.array(
        system.residual_function(
            states.ravel(), controls.ravel(), costates.ravel(), weights.ravel()
        )
    ).ravel()
    in_states, in_controls, _ = np.split(residual, [costates.size, costates.size + controls.size])
    in_states, in_controls = in_states.reshape(costates.shape), in_controls.reshape(controls.shape)
    h = 1e-6
    for t, i in ((0, 0), (3, 2), (8, 1)):
        for k in range(4):
            up, down = states.copy(), states.copy()
            up[t + 1, i, k] += h
            down[t + 1, i, k] -= h
            slope = (lagrangian(i, up, controls) - lagrangian(i, down, controls)) / (2 * h)
            assert in_states[t, i, k] == pytest.approx(slope, abs=1e-6)
        for k in range(2):
            up, down = controls.copy(), controls.copy()
            up[t, i, k] += h
            down[t, i, k] -= h
            slope = (lagrangian(i, states, up) - lagrangian(i, states, down)) / (2 * h)
            assert in_controls[t, i, k] == pytest.approx(slope, abs=1e-6)


def _step_of(game: Game) -> tuple[list[ca.SX], list[ca.SX]]:
    state, control = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    return [state, control], [UNICYCLE.step(state, control, game.dt)]


@given(st.lists(st.floats(0.01, 100), min_size=3, max_size=3))
def test_weights_matter_up_to_each_players_scale(
    crossing: Crossing, olne: Equilibrium, scales: list[float]
) -> None:
    """Scaled weights and costates leave G at zero: behaviour depends on ratios only."""
    game, weights, _ = crossing
    scale = np.array(scales)
    residual = kkt_residual_norm(
        game, olne.states, olne.controls, scale[:, None] * olne.costates, scale[:, None] * weights
    )
    assert residual < 1e-10 * scale.max() + 1e-12


def test_residual_is_zero_at_an_equilibrium_and_not_beside_it(
    crossing: Crossing, olne: Equilibrium
) -> None:
    game, weights, _ = crossing
    assert kkt_residual_norm(game, olne.states, olne.controls, olne.costates, weights) < 1e-9
    elsewhere = olne.controls + 1e-3
    assert kkt_residual_norm(game, olne.states, elsewhere, olne.costates, weights) > 1e-6
    other_weights = weights[:, ::-1]
    assert kkt_residual_norm(game, olne.states, olne.controls, olne.costates, other_weights) > 1e-3


def test_consistent_costates_are_those_of_the_equilibrium(
    crossing: Crossing, olne: Equilibrium
) -> None:
    game, weights, _ = crossing
    costates = consistent_costates(game, olne.states, olne.controls, weights)
    np.testing.assert_allclose(costates, olne.costates, atol=1e-10)


def test_consistent_costates_make_any_trajectory_stationary_in_its_states(
    crossing: Crossing,
) -> None:
    game, weights, initial_state = crossing
    controls = np.random.default_rng(0).standard_normal(game.control_shape)
    states = rollout(game.dynamics, initial_state, controls, game.dt)
    costates = consistent_costates(game, states, controls, weights)
    residual = np.array(
        kkt_system(game).residual_function(
            states.ravel(), controls.ravel(), costates.ravel(), weights.ravel()
        )
    ).ravel()
    assert np.abs(residual[: costates.size]).max() < 1e-10
    assert np.abs(residual[costates.size : costates.size + controls.size]).max() > 1e-3
    assert np.abs(residual[costates.size + controls.size :]).max() < 1e-12


def test_unknowns_are_as_many_as_conditions(crossing: Crossing) -> None:
    system = kkt_system(crossing[0])
    assert system.unknowns.numel() == system.residual.numel()

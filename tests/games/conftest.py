"""Small games on which properties are quick to check."""

from collections.abc import Callable

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.solve.kkt import kkt_system
from olne_bench.games.solve.newton import unpack
from olne_bench.games.solve.olne import Equilibrium, solve_olne

GoalGame = Callable[..., Game]


@pytest.fixture(scope="session")
def goal_game() -> GoalGame:
    """``goal_game(goals, horizon, dt)``: vehicles that head for goals and avoid each other."""

    def make(goals: np.ndarray, horizon: int = 10, dt: float = 0.5) -> Game:
        preferences = (
            Proximity(),
            StateDeviation("speed"),
            ControlEffort("acceleration", scale=10.0),
            ControlEffort("yaw_rate"),
        )
        players = [Player(preferences, (FinalGoal((float(x), float(y))),)) for x, y in goals]
        return Game(tuple(players), UNICYCLE, horizon, dt)

    return make


@pytest.fixture(scope="session")
def crossing(goal_game: GoalGame) -> tuple[Game, np.ndarray, np.ndarray]:
    """Three players without symmetries: game, weights (rows sum to one), initial state."""
    game = goal_game(np.array([[1.0, 0.2], [0.1, 1.0], [-0.9, -0.5]]))
    weights = np.array([[0.4, 0.2, 0.1, 0.3], [0.1, 0.3, 0.2, 0.4], [0.2, 0.2, 0.4, 0.2]])
    initial_state = np.array([[-1, 0, 0.1, 0.2], [0.1, -1.1, 1.5, 0.1], [0.8, 0.9, -2.3, 0.15]])
    return game, weights, initial_state


@pytest.fixture(scope="session")
def olne(crossing: tuple[Game, np.ndarray, np.ndarray]) -> Equilibrium:
    return solve_olne(*crossing)


def rows_agree(game: Game) -> None:
    """Check that the elimination's residual is that of the costs as they are written down."""
    rng, solver = np.random.default_rng(1), elimination(game)
    states, inner = solver.stages.num_states, solver.stages.num_states + solver.stages.num_controls
    z = rng.uniform(0.5, 1.5, (game.horizon, solver.stages.size))
    z[-1, states:] = 0
    theta = rng.uniform(0.1, 1, solver.stages.num_weights)
    point = [part.ravel() for part in unpack(game, z)]
    wanted = np.array(kkt_system(game).residual_function(*point, theta)).ravel()
    rows = solver.evaluate(z, theta)
    found = [rows[1:, :states], rows[:-1, states:inner], rows[:-1, inner:]]
    np.testing.assert_allclose(np.concatenate([f.ravel() for f in found]), wanted, atol=1e-12)


@pytest.fixture(scope="session")
def scenario_equilibrium() -> Callable[[str], Equilibrium]:
    """The equilibrium of a fixed scenario, solved once, from a cold start."""
    solved: dict[str, Equilibrium] = {}

    def get(name: str) -> Equilibrium:
        if name not in solved:
            scenario = get_scenario(name)
            solved[name] = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
        return solved[name]

    return get

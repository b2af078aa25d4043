"""Constraints as equations: derivatives are true, roots are equilibria, nobody ignores them."""

import casadi as ca
import numpy as np
import pytest

from olne_bench.estimators.shared.joint_ipopt import joint_solver
from olne_bench.games.compiled.complementarity import RELAXATION, _smooth
from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.model.constraints import ControlBound, Distance, Ellipse, StateBound
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.equilibrium import Equilibrium
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.best_response import best_responses
from olne_bench.games.solve.continuation import follow_coupling
from olne_bench.games.solve.information import trajectory_sensitivity
from olne_bench.games.solve.kkt import kkt_system
from olne_bench.games.solve.nearest_root import predict
from olne_bench.games.solve.newton import Root, pack, unpack
from olne_bench.games.solve.olne import certify, solve_olne

START = np.array([[-1.0, 0.0, 0.1, 0.3], [0.1, -1.0, 1.5, 0.25]])
WEIGHTS = np.array([[0.2, 0.3, 0.5], [0.3, 0.4, 0.3]])


def _game(*constraints: object, coupled: bool = True) -> Game:
    likes = (StateDeviation("speed"), ControlEffort("acceleration", 10.0))
    likes += (Proximity() if coupled else ControlEffort("yaw_rate"),)
    goals = ((1.0, 0.0), (0.0, 1.0))
    players = tuple(
        Player(likes, (FinalGoal(goal, scale=10.0), ControlEffort("yaw_rate"))) for goal in goals
    )
    return Game(players, UNICYCLE, 12, 0.4, constraints)  # type: ignore[arg-type]


GAME = _game(
    Distance((1, 0), 0.5),
    ControlBound((0,), "acceleration", -0.2, 0.2),
    StateBound((1,), "speed", upper=0.45, first_step=2),
)


@pytest.fixture(scope="module")
def found() -> Equilibrium:
    solution = solve_olne(GAME, WEIGHTS, START)
    assert solution.certificate.passed
    assert solution.active[:, 0].any()
    assert solution.active[:, 1:].any()
    return solution


def _root(found: Equilibrium) -> Root:
    return Root(found.states, found.controls, found.costates, found.residual)


def _random_point(solver: Elimination) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    z, d = 0.5 * rng.standard_normal((2, 12, solver.stages.size))
    end = solver.stages.num_states
    z[-1, end:] = d[-1, end:] = d[0, :end] = 0
    return z, d


def test_the_smooth_equation_says_complementarity() -> None:
    g, v, tau = (ca.SX.sym(name) for name in "gvt")
    phi = ca.Function("phi", [g, v, tau], [_smooth(g, v, tau)])
    for margin in (1e-7, 1e-3, 1.0, 1e3):
        assert abs(float(phi(margin, 1e-9 / margin, 1e-9))) < 1e-15 * (1 + margin)
    assert float(phi(-1.0, 0.0, 1e-9)) == pytest.approx(-2)
    assert float(phi(0.5, 0.5, 1e-9)) == pytest.approx(1 - np.sqrt(0.5))
    assert np.isfinite(float(phi(-1e6, 0.0, 1e-9)))


def test_derivatives_are_true() -> None:
    solver, theta, h = elimination(GAME), WEIGHTS.ravel(), 1e-6
    z, d = _random_point(solver)
    assert solver.linearise(z, theta)
    step = solver.solve(d)
    ahead, behind = (solver.evaluate(z + sign * h * step, theta) for sign in (1, -1))
    assert np.allclose((ahead - behind) / (2 * h), d, atol=1e-5 * np.abs(d).max())


def test_second_derivatives_are_true() -> None:
    solver, theta, h = elimination(GAME), WEIGHTS.ravel(), 1e-6
    z, d = _random_point(solver)
    multipliers = np.random.default_rng(1).standard_normal(z.shape)
    multipliers[0, : solver.stages.num_states] = multipliers[-1, solver.stages.num_states :] = 0
    solver.set_observations(np.full((12, solver.num_samples), np.nan))
    solver.linearise(z, theta)
    solver.sensitivities()
    solver.reduced_hessian(z, theta, multipliers)
    product, _ = solver.hessian_product(d, np.zeros(theta.size))

    def slope(sign: int) -> float:
        """The derivative of multipliers' G along d."""
        point = z + sign * h * d
        values = [solver.evaluate(point + k * 1e-4 * d, theta) for k in (1, -1)]
        return float((multipliers * (values[0] - values[1])).sum() / 2e-4)

    h = 1e-3
    second = (slope(1) - slope(-1)) / (2 * h)
    assert float((d * product).sum()) == pytest.approx(second, rel=1e-3)


def test_packing_finds_the_multipliers(found: Equilibrium) -> None:
    solver = elimination(GAME)
    z = pack(GAME, found.states, found.controls, found.costates, WEIGHTS)
    assert np.abs(solver.evaluate(z, WEIGHTS.ravel())).max() < 1e-6
    for part, back in zip(
        (found.states, found.controls, found.costates), unpack(GAME, z), strict=True
    ):
        assert np.array_equal(part, back)
    first = GAME.num_players * (4 + 2)
    multipliers = z[:-1, first : first + solver.stages.num_multipliers]
    # of the distance, taken after each step; of both bounds of the control, taken in the step
    assert np.allclose(multipliers[:, 0], found.multipliers[1:, 0], rtol=1e-3, atol=1e-7)
    assert np.allclose(multipliers[:, 1:3], found.multipliers[:-1, 1:3], rtol=1e-3, atol=1e-7)
    products = multipliers * solver.step_margins(z, WEIGHTS.ravel())
    assert np.allclose(products[solver.enforced[:-1]], RELAXATION, rtol=1e-6)


def test_games_of_a_batch_are_equilibria_and_sensitivities_are_true(found: Equilibrium) -> None:
    rng = np.random.default_rng(0)
    weights = WEIGHTS * rng.uniform(0.9, 1.1, (6, *WEIGHTS.shape))
    weights[-1] = [[0.6, 0.2, 0.2], [0.2, 0.2, 0.6]]  # other constraints are active there
    weights /= weights.sum(axis=2, keepdims=True)
    batch = solve_batch(GAME, weights, _root(found), WEIGHTS)
    assert batch.converged.all()
    for k in (0, 5):
        assert certify(GAME, batch.root(k), weights[k]).passed
    h = 1e-5 * np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    near = solve_batch(GAME, np.stack([WEIGHTS + h, WEIGHTS - h]), _root(found), WEIGHTS)
    sensitivity = trajectory_sensitivity(
        GAME, found.states, found.controls, found.costates, WEIGHTS
    )
    change = (sensitivity[:, : WEIGHTS.size] @ h.ravel()).reshape(found.states.shape)
    assert np.allclose(
        (near.states[0] - near.states[1]) / 2, change, atol=1e-3 * np.abs(change).max()
    )


def test_predictions_are_followed_from_the_truth(found: Equilibrium) -> None:
    weights = np.array([[0.25, 0.3, 0.45], [0.3, 0.35, 0.35]])
    prediction = predict(GAME, weights, _root(found), WEIGHTS)
    assert prediction.root is not None
    assert certify(GAME, prediction.root, weights).passed
    root = prediction.root
    z = pack(GAME, root.states, root.controls, root.costates, weights)
    margins = elimination(GAME).step_margins(z, weights.ravel())
    assert margins[:, :3].min() > 0


def test_ellipses_are_kept_in_a_solution() -> None:
    game = _game(Ellipse((0, 1), length=0.6, width=0.3), coupled=False)
    found = solve_olne(game, WEIGHTS, START)
    assert found.certificate.passed
    assert found.active.any()
    offset = found.states[:, 1, :2] - found.states[:, 0, :2]
    heading = found.states[:, 0, 2]
    ahead = offset[:, 0] * np.cos(heading) + offset[:, 1] * np.sin(heading)
    beside = offset[:, 1] * np.cos(heading) - offset[:, 0] * np.sin(heading)
    assert ((ahead / 0.6) ** 2 + (beside / 0.3) ** 2).min() == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(
    "call",
    [
        lambda: kkt_system(GAME),
        lambda: best_responses(
            GAME, 0, np.zeros((1, 11, 2)), np.zeros((12, 2, 4)), np.zeros((11, 2, 2)), WEIGHTS
        ),
        lambda: follow_coupling(GAME, WEIGHTS, START, np.zeros((11, 2, 2))),
        lambda: joint_solver(GAME, VIEWS["full"], 1, 10, 1e-8),
    ],
)
def test_what_knows_no_constraints_refuses_them(call: object) -> None:
    message = "knows no constraints, but the game has constraint 'distance' of players 1 and 0"
    with pytest.raises(ValueError, match=message) as error:
        call()  # type: ignore[operator]
    assert "\n" not in str(error.value)

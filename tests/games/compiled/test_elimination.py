"""The block elimination against the stacked system, and what it does with bad input."""

import ctypes

import casadi as ca
import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.model.observation import VIEWS
from olne_bench.games.solve.kkt import kkt_system
from olne_bench.games.solve.newton import unpack

SCENARIOS = {
    "two players": lambda: get_scenario("two_player"),
    "three players": lambda: get_scenario("random", 1, num_players=3),
    "highway": lambda: get_scenario("highway_overtaking"),
    "one player": lambda: get_scenario("random", 1, num_players=1),
    "on lanes": lambda: get_scenario("two_way", 0),
}


class Case:
    """A random point of a game, its elimination, and random multipliers."""

    def __init__(self, name: str) -> None:
        scenario = SCENARIOS[name]()
        self.game, self.theta = scenario.game, scenario.weights.ravel()
        self.view = VIEWS["partial"]
        self.solver = elimination(self.game, self.view)
        stages = self.solver.stages
        self.nx, self.inner = stages.num_states, stages.num_states + stages.num_controls
        rng = np.random.default_rng(3)
        shape = (self.game.horizon, stages.size)
        self.z, self.right = 0.3 * rng.standard_normal(shape), rng.standard_normal(shape)
        self.z[-1, self.nx :] = 0
        self.right[0, : self.nx] = self.right[-1, self.nx :] = 0
        self.y = rng.standard_normal((self.game.horizon, self.solver.num_samples))
        self.y[2, 1] = np.nan
        self.solver.set_observations(self.y)

    def stacked(self, rows: np.ndarray) -> np.ndarray:
        """Rows (T, size) in the order of ``games.solve.kkt``."""
        parts = rows[1:, : self.nx], rows[:-1, self.nx : self.inner], rows[:-1, self.inner :]
        return np.concatenate([part.ravel() for part in parts])

    def jacobians(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """G, G_z and G_(x_1, theta) from the stacked system."""
        system = kkt_system(self.game)
        arguments = [system.states, system.controls, system.costates, system.weights]
        parameters = ca.vertcat(system.initial_state, system.weights)
        outputs = [
            system.residual,
            ca.jacobian(system.residual, system.unknowns),
            ca.jacobian(system.residual, parameters),
        ]
        trajectory = [part.ravel() for part in unpack(self.game, self.z)]
        values = ca.Function("G", arguments, outputs)(*trajectory, self.theta)
        return tuple(np.array(value) for value in values)


@pytest.fixture(scope="module", params=SCENARIOS)
def case(request: pytest.FixtureRequest) -> Case:
    return Case(request.param)


def test_rows_and_solutions_are_those_of_the_stacked_system(case: Case) -> None:
    residual, in_unknowns, in_parameters = case.jacobians()
    solver = case.solver
    np.testing.assert_allclose(
        case.stacked(solver.evaluate(case.z, case.theta)), residual.ravel(), atol=1e-12
    )
    assert solver.linearise(case.z, case.theta)
    right = case.stacked(case.right)
    for transposed, matrix in ((False, in_unknowns), (True, in_unknowns.T)):
        found = case.stacked(solver.solve(case.right, transposed=transposed))
        wanted = np.linalg.solve(matrix, right)
        np.testing.assert_allclose(found, wanted, atol=1e-8 * np.abs(wanted).max())
    columns = np.moveaxis(solver.sensitivities(), 2, 0)
    found = np.stack([case.stacked(column) for column in columns], axis=1)
    wanted = -np.linalg.solve(in_unknowns, in_parameters)
    np.testing.assert_allclose(found, wanted, atol=1e-8 * np.abs(wanted).max())

    Z, d = solver.sensitivities().copy(), np.linspace(-1, 1, columns.shape[0])
    np.testing.assert_allclose(solver.expand(d), Z @ d, atol=1e-9 * np.abs(Z).max())
    reduced = np.tensordot(case.right, Z, axes=2)
    np.testing.assert_allclose(solver.reduce(case.right), reduced, atol=1e-9 * abs(reduced).max())
    seen = Z[:, : case.inner].reshape(-1, columns.shape[0])
    metric = seen.T @ seen
    np.testing.assert_allclose(solver.trajectory_metric(), metric, atol=1e-9 * metric.max())


def test_second_derivatives_are_those_of_the_lagrangian(case: Case) -> None:
    """H in a random direction by second differences of loss + multipliers' G; then W = Z' H Z."""
    solver, multipliers = case.solver, case.right
    solver.linearise(case.z, case.theta)
    Z = solver.sensitivities()
    W = solver.reduced_hessian(case.z, case.theta, multipliers)
    rng = np.random.default_rng(5)
    d, d_theta = rng.standard_normal(case.z.shape), rng.standard_normal(case.theta.shape)
    d[-1, case.nx :] = 0

    def lagrangian(step: float) -> float:
        z, theta = case.z + step * d, case.theta + step * d_theta
        return solver.observation_loss(z)[0] + np.vdot(multipliers, solver.evaluate(z, theta))

    step = 1e-4
    curvature = (lagrangian(step) - 2 * lagrangian(0) + lagrangian(-step)) / step**2
    product, product_theta = solver.hessian_product(d, d_theta)
    wanted = np.vdot(product, d) + product_theta @ d_theta
    assert curvature == pytest.approx(wanted, rel=1e-4)

    gradient = solver.observation_loss(case.z)[1]
    losses = [solver.observation_loss(case.z + sign * step * d)[0] for sign in (1, -1)]
    assert (losses[0] - losses[1]) / (2 * step) == pytest.approx(np.vdot(gradient, d), rel=1e-6)

    for k in (0, Z.shape[2] - 1):
        unit = np.eye(case.theta.size, Z.shape[2], case.nx)[:, k]
        product, product_theta = solver.hessian_product(Z[:, :, k], unit)
        column = solver.reduce(product)
        column[case.nx :] += product_theta
        np.testing.assert_allclose(column, W[:, k], atol=1e-9 * np.abs(W).max())


def test_newton_takes_shorter_steps_where_whole_ones_lead_astray() -> None:
    """The residual never grows, and a start of little promise is left after a whole search."""
    case = Case("two players")
    rng = np.random.default_rng(0)
    shortened = 0
    for _ in range(4):
        point = case.z + 0.5 * rng.standard_normal(case.z.shape)
        point[-1, case.nx :] = 0
        norms = [np.linalg.norm(case.solver.evaluate(point, case.theta))]
        for _ in range(25):
            before = point.copy()
            residual = case.solver.evaluate(before, case.theta)
            assert case.solver.linearise(before, case.theta)
            whole = case.solver.solve(residual)
            batch = point[None].copy()
            largest, taken = case.solver.newton(
                batch, case.theta[None], tolerance=1e-10, max_iterations=1, limit=10.0
            )
            point = batch[0]
            np.testing.assert_array_equal(point[0, : case.nx], before[0, : case.nx])
            last = case.solver.evaluate(point, case.theta)
            assert largest[0] == np.abs(last).max()
            assert taken[0] == 1
            if np.array_equal(point, before) or largest[0] < 1e-10:
                break
            norms.append(np.linalg.norm(last))
            if norms[-1] < 0.1 * norms[-2]:
                continue  # more steps with the same factorisation have followed
            share = np.vdot(before - point, whole) / np.vdot(whole, whole)
            assert np.log2(share) == pytest.approx(round(np.log2(share)), abs=1e-6)
            shortened += share < 0.9
        assert (np.diff(norms) < 0).all()
    assert shortened > 0


@pytest.mark.parametrize("count", [1, 6])
def test_sensitivities_of_samples_are_those_of_states(count: int) -> None:
    """Of one game and of many, whatever is beside a game that is singular."""
    case = Case("two players")
    solver, steps = elimination(case.game), case.game.horizon
    rng = np.random.default_rng(0)
    z = case.z + 0.01 * rng.standard_normal((count, *case.z.shape))
    theta = np.repeat(case.theta[None], count, axis=0)
    theta[3:4] = 0
    seen = rng.standard_normal((count, steps, 2, 3, 4))
    found, regular = solver.observe_sensitivities(z, theta, seen)
    assert regular.tolist() == [k != 3 for k in range(count)]
    for k in np.flatnonzero(regular):
        assert solver.linearise(z[k], theta[k])
        states = solver.sensitivities()[:, : case.nx].reshape(steps, 2, 4, -1)
        np.testing.assert_allclose(found[k], seen[k] @ states, rtol=1e-9, atol=1e-9)


def test_a_singular_stage_is_reported() -> None:
    """Without any cost on motion nothing determines the controls."""
    scenario = get_scenario("two_player")
    theta = np.zeros(scenario.weights.size)
    z = np.zeros((scenario.game.horizon, 20))
    assert not elimination(scenario.game).linearise(z, theta)
    assert not elimination(scenario.game).linearise(np.full_like(z, np.nan), theta + 0.25)


def test_what_reaches_native_code_is_checked() -> None:
    case = Case("two players")
    solver = elimination(case.game, case.view)
    z, theta = case.z, case.theta
    wanted = solver.evaluate(z, theta)
    for same in (np.asfortranarray(z), np.repeat(z, 2, axis=1)[:, ::2]):
        np.testing.assert_array_equal(solver.evaluate(same, theta), wanted)
    np.testing.assert_allclose(solver.evaluate(z.astype(np.float32), theta), wanted, atol=1e-5)
    with pytest.raises(ValueError, match=r"z has the shape \(24, 20\), expected \(25, 20\)"):
        solver.evaluate(z[:-1], theta)
    with pytest.raises(ValueError, match=r"theta has the shape \(7,\)"):
        solver.linearise(z, theta[:-1])
    with pytest.raises(ValueError, match=r"y has the shape \(25, 5\), expected \(25, 6\)"):
        solver.set_observations(case.y[:, :5])
    with pytest.raises(ValueError, match=r"noise_scale has the shape \(5,\)"):
        solver.set_observations(case.y, np.ones(5))
    batch = np.repeat(z[None], 2, axis=0)
    options = {"tolerance": 1e-9, "max_iterations": 2, "limit": 1.0}
    with pytest.raises(ValueError, match=r"theta has the shape \(1, 8\), expected \(2, 8\)"):
        solver.newton(batch, theta[None], **options)
    batch.setflags(write=False)
    with pytest.raises(ValueError, match="z is overwritten"):
        solver.newton(batch, np.repeat(theta[None], 2, axis=0), **options)


def test_signatures_refuse_what_the_checks_should_have_caught() -> None:
    case = Case("two players")
    solver = elimination(case.game, case.view)
    with pytest.raises(ctypes.ArgumentError, match="data type float64"):
        solver.library.linearise(solver.work, case.z.astype(np.float32), case.theta)


def test_single_precision_observations_are_not_read_as_double() -> None:
    case = Case("two players")
    solver = elimination(case.game, case.view)
    rough = case.y.astype(np.float32)
    solver.set_observations(rough.astype(float))
    wanted = solver.observation_loss(case.z)[0]
    solver.set_observations(rough)
    assert solver.observation_loss(case.z)[0] == wanted

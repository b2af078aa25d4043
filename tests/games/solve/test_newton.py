"""Newton's method, sensitivities and batches of forward games."""

import dataclasses
import math

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.games.compiled.elimination import elimination
from olne_bench.games.compiled.source import source_of
from olne_bench.games.compiled.stage_functions import stage_functions
from olne_bench.games.solve.batch import solve_batch
from olne_bench.games.solve.information import trajectory_sensitivity
from olne_bench.games.solve.newton import newton_root, rows, unpack
from olne_bench.games.solve.olne import Equilibrium, solve_olne


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return get_scenario("two_player")


@pytest.fixture(scope="module")
def equilibrium(scenario: Scenario) -> Equilibrium:
    return solve_olne(scenario.game, scenario.weights, scenario.initial_state)


@pytest.fixture(scope="module")
def nearby(scenario: Scenario) -> np.ndarray:
    rng = np.random.default_rng(0)
    weights = np.exp(0.3 * rng.standard_normal((20, *scenario.weights.shape)))
    return weights / weights.sum(axis=2, keepdims=True)


def test_pack_and_unpack_are_inverse(scenario: Scenario, equilibrium: Equilibrium) -> None:
    parts = (equilibrium.states, equilibrium.controls, equilibrium.costates)
    for part, back in zip(parts, unpack(scenario.game, rows(scenario.game, *parts)), strict=True):
        np.testing.assert_array_equal(part, back)


def test_newton_returns_to_a_root_and_stops_at_its_limits(
    scenario: Scenario, equilibrium: Equilibrium
) -> None:
    game = scenario.game
    start = equilibrium.states.copy()
    start[1:] += 0.01
    others = equilibrium.controls + 0.01, equilibrium.costates + 0.01
    arguments = (game, start, *others, scenario.weights)
    root = newton_root(*arguments)
    assert root.residual < 1e-12
    for part in ("states", "controls", "costates"):
        np.testing.assert_allclose(getattr(root, part), getattr(equilibrium, part), atol=1e-9)
    for limits in ({"max_iterations": 0}, {"limit": 0.0}):
        stopped = newton_root(*arguments, **limits)
        assert stopped.residual > 1e-4
        np.testing.assert_array_equal(stopped.states, start)


def test_newton_returns_an_undefined_start_as_it_is(
    scenario: Scenario, equilibrium: Equilibrium
) -> None:
    states = np.full_like(equilibrium.states, np.nan)
    root = newton_root(
        scenario.game, states, equilibrium.controls, equilibrium.costates, scenario.weights
    )
    assert not root.residual < math.inf


def test_a_factorisation_serves_several_steps(scenario: Scenario, equilibrium: Equilibrium) -> None:
    game, solver = scenario.game, elimination(scenario.game)
    limits = {"tolerance": 1e-10, "max_iterations": 20, "limit": 10.0}
    point = rows(game, equilibrium.states, equilibrium.controls, equilibrium.costates)[None]
    start, theta = point.copy(), scenario.weights.reshape(1, -1)
    start[:, 0, :8] += 1e-3 * np.random.default_rng(0).standard_normal(8)
    fresh, warm = start.copy(), start.copy()
    residuals, used = solver.newton(fresh, theta, **limits)
    assert (residuals[0] < 1e-10, used[0]) == (True, 1)
    assert solver.linearise(point[0], theta[0])
    residuals, used = solver.newton(warm, theta, factorised=True, **limits)
    assert (residuals[0] < 1e-10, used[0]) == (True, 0)
    np.testing.assert_allclose(fresh, warm, atol=1e-7)
    with pytest.raises(ValueError, match="not near the starts of 2 games"):
        solver.newton(
            np.repeat(start, 2, axis=0), np.repeat(theta, 2, axis=0), factorised=True, **limits
        )


def test_what_becomes_of_a_game_does_not_depend_on_others(
    scenario: Scenario, equilibrium: Equilibrium
) -> None:
    """Neither on their order nor on their number, whether they are solved or not."""
    solver = elimination(scenario.game)
    limits = {"tolerance": 1e-10, "max_iterations": 6, "limit": 10.0}
    point = rows(scenario.game, equilibrium.states, equilibrium.controls, equilibrium.costates)
    rng = np.random.default_rng(3)
    starts = point + np.geomspace(1e-3, 1, 23)[:, None, None] * rng.standard_normal(point.shape)
    starts[:, -1, 8:] = 0
    starts[7] = np.nan
    theta = rng.dirichlet(np.ones(4), size=(23, 2)).reshape(23, -1)
    theta[11] = 0  # singular
    together = starts.copy()
    residuals, used = solver.newton(together, theta, **limits)
    assert 5 < (residuals < 1e-10).sum() < 20
    for chosen in (rng.permutation(23), np.arange(5), np.array([20, 2])):
        some = starts[chosen]
        found, needed = solver.newton(some, theta[chosen], **limits)
        np.testing.assert_array_equal(found, residuals[chosen])
        np.testing.assert_array_equal(needed, used[chosen])
        np.testing.assert_array_equal(some, together[chosen])
    for k in (0, 1, 7, 11):
        alone = starts[k : k + 1].copy()
        found, needed = solver.newton(alone, theta[k : k + 1], **limits)
        assert needed[0] == used[k]
        np.testing.assert_allclose(alone[0], together[k], atol=1e-9)


@pytest.mark.parametrize("which", ["weights", "initial state"])
def test_sensitivities_are_finite_differences(
    scenario: Scenario, equilibrium: Equilibrium, which: str
) -> None:
    game, count = scenario.game, scenario.weights.size
    found = trajectory_sensitivity(
        game, equilibrium.states, equilibrium.controls, equilibrium.costates, scenario.weights
    )
    step = 1e-5
    for column in (1, 6):
        ends = []
        for sign in (1, -1):
            weights, states = scenario.weights.copy(), equilibrium.states.copy()
            changed = weights if which == "weights" else states[0]
            changed.ravel()[column] += sign * step
            root = newton_root(game, states, equilibrium.controls, equilibrium.costates, weights)
            assert root.residual < 1e-11
            ends.append(root.states.ravel())
        wanted = (ends[0] - ends[1]) / (2 * step)
        offset = 0 if which == "weights" else count
        np.testing.assert_allclose(found[:, offset + column], wanted, atol=1e-6)


def test_a_batch_is_what_single_solves_give(
    scenario: Scenario, equilibrium: Equilibrium, nearby: np.ndarray
) -> None:
    rng = np.random.default_rng(1)
    shape = (len(nearby), *scenario.initial_state.shape)
    initial = scenario.initial_state + 0.02 * rng.standard_normal(shape)
    batch = solve_batch(
        scenario.game, nearby, equilibrium, scenario.weights, initial_states=initial
    )
    assert batch.converged.all()
    np.testing.assert_array_equal(batch.states[:, 0], initial)
    for k in range(3):
        start = equilibrium.states.copy()
        start[0] = initial[k]
        alone = newton_root(
            scenario.game, start, equilibrium.controls, equilibrium.costates, nearby[k]
        )
        np.testing.assert_allclose(batch.states[k], alone.states, atol=1e-9)
    order = rng.permutation(len(nearby))
    shuffled = solve_batch(
        scenario.game, nearby[order], equilibrium, scenario.weights, initial_states=initial[order]
    )
    np.testing.assert_array_equal(shuffled.states, batch.states[order])


def test_a_batch_goes_far_in_steps_and_tells_what_it_could_not_solve(
    scenario: Scenario, equilibrium: Equilibrium
) -> None:
    weights = np.random.default_rng(2).dirichlet(np.ones(4), size=(60, 2))
    batch = solve_batch(scenario.game, weights, equilibrium, scenario.weights)
    assert batch.converged.mean() > 0.9
    stopped = solve_batch(scenario.game, weights, equilibrium, scenario.weights, limit=0.0)
    assert not stopped.converged.any()
    empty = solve_batch(scenario.game, weights[:0], equilibrium, scenario.weights)
    assert empty.states.shape == (0, *equilibrium.states.shape)


def test_a_batch_refuses_bad_input(scenario: Scenario, equilibrium: Equilibrium) -> None:
    weights = np.full((3, 2, 4), 0.25)
    with pytest.raises(ValueError, match=r"shape \(2, 4\)"):
        solve_batch(scenario.game, weights[0], equilibrium, scenario.weights)
    for bad in (np.nan, -0.1):
        weights[1, 0, 0] = bad
        with pytest.raises(ValueError, match="entry 1"):
            solve_batch(scenario.game, weights, equilibrium, scenario.weights)
    weights[1, 0, 0] = 0.25
    with pytest.raises(ValueError, match="initial_states have"):
        solve_batch(
            scenario.game, weights, equilibrium, scenario.weights, initial_states=np.zeros(3)
        )


def test_games_that_differ_in_numbers_share_one_library() -> None:
    goals = [get_scenario("random", seed, num_players=2).game for seed in (1, 2)]
    games = [*goals, dataclasses.replace(goals[0], dt=0.2, horizon=7)]
    assert len({stage_functions(game) for game in games}) == 1
    sources = {source_of(stage_functions(game)) for game in games}
    assert len(sources) == 1
    other = get_scenario("random", 1, num_players=3).game
    source, functions = source_of(stage_functions(other))
    assert {functions} == {one for _, one in sources} and source not in {s for s, _ in sources}

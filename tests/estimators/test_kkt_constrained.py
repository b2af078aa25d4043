"""The joint method as an estimator."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from olne_bench.envs.recordings.recording import record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.bilevel import Bilevel
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared import joint_starts as module
from olne_bench.estimators.shared.joint_problem import JointSolution, Status
from olne_bench.games.model.observation import VIEWS, observe
from olne_bench.games.solve.olne import solve_olne

RNG = np.random.default_rng(0)


def observed(view_name: str, sigma: float, seed: int = 0) -> tuple[Problem, np.ndarray]:
    scenario = get_scenario("two_player")
    truth = solve_olne(scenario.game, scenario.weights, scenario.initial_state)
    view = VIEWS[view_name]
    y = observe(view, scenario.game.dynamics, truth.states)
    y = y + sigma * np.random.default_rng(seed).standard_normal(y.shape)
    return Problem(scenario.game, view, sigma), y


@pytest.mark.parametrize("solver", ["structured", "ipopt"])
@pytest.mark.parametrize("view", ["full", "partial"])
def test_noise_free_data_give_the_true_weights(solver: str, view: str) -> None:
    problem, y = observed(view, 0.0)
    estimator = KktConstrained(solver=solver)
    estimator.warm_up(problem)
    estimate = estimator.estimate(problem, Observation(y), rng=RNG, budget=60)
    assert estimate.converged
    np.testing.assert_allclose(estimate.weights, 0.25, atol=1e-5)
    assert estimate.extras["objective"] < 1e-12


def test_both_solvers_estimate_the_same_from_noisy_data() -> None:
    problem, y = observed("partial", 0.03)
    results = [
        KktConstrained(solver=solver).estimate(problem, Observation(y), rng=RNG, budget=60)
        for solver in ("structured", "ipopt")
    ]
    assert all(result.converged for result in results)
    np.testing.assert_allclose(results[0].weights, results[1].weights, atol=1e-4)


@pytest.mark.parametrize(("solver", "starts"), [("structured", 2), ("ipopt", 3)])
def test_starts_that_agree_are_enough(solver: str, starts: int) -> None:
    problem, y = observed("full", 0.01)
    easy = KktConstrained(solver=solver).estimate(problem, Observation(y), rng=RNG, budget=60)
    assert easy.extras["starts"] == starts


def test_where_time_ends_the_search_the_estimate_says_so() -> None:
    problem, y = observed("full", 0.01)
    cut = KktConstrained().estimate(problem, Observation(y), rng=RNG, budget=0.0)
    assert not cut.converged
    assert cut.message == "time limit reached"
    late = KktConstrained(solver="ipopt").estimate(problem, Observation(y), rng=RNG, budget=0.0)
    assert late.converged and late.extras["starts"] == 1
    assert late.message.startswith("time limit reached in start 1")


def test_starts_that_disagree_call_for_more() -> None:
    problem, y = observed("partial", 0.1, seed=7)
    hard = KktConstrained().estimate(problem, Observation(y), rng=RNG, budget=60)
    assert hard.converged
    assert hard.extras["starts"] == 6


def test_ipopt_serves_where_no_start_of_the_structured_solver_converges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, y = observed("full", 0.01)
    own = module.solve_joint_motions

    def lost(*arguments: Any, **options: Any) -> JointSolution:
        return replace(own(*arguments, **options), status=Status.NO_STEP)

    monkeypatch.setattr(module, "solve_joint_motions", lost)
    rescued = KktConstrained().estimate(problem, Observation(y), rng=RNG, budget=60)
    expected = KktConstrained(solver="ipopt").estimate(problem, Observation(y), rng=RNG, budget=60)
    assert rescued.converged
    np.testing.assert_array_equal(rescued.weights, expected.weights)
    late = KktConstrained().estimate(problem, Observation(y), rng=RNG, budget=0)
    assert not late.converged


@pytest.mark.parametrize("solver", ["structured", "ipopt"])
def test_a_solve_cut_short_does_not_pass_for_converged(solver: str) -> None:
    problem, y = observed("full", 0.01)
    limited = KktConstrained(solver=solver, max_iterations=2)
    hard = limited.estimate(problem, Observation(y), rng=RNG, budget=60)
    assert not hard.converged
    assert hard.message


def test_a_player_never_seen_is_not_identified() -> None:
    problem, y = observed("full", 0.01)
    y[:, 1] = np.nan
    estimate = KktConstrained().estimate(problem, Observation(y), rng=RNG, budget=60)
    assert not estimate.converged
    assert estimate.message == "never seen, hence not identified: player 1"


def test_an_unknown_solver_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown solver 'fast'; known are: structured, ipopt"):
        KktConstrained(solver="fast")


@pytest.mark.parametrize("view", ["full", "partial"])
@pytest.mark.parametrize("sigma", [0.1, 1.0])
def test_noise_in_metres_on_highway_env_roads(sigma: float, view: str) -> None:
    """Errors in metres, radians and metres per second count by their scale, and none is lost."""
    recording = record(get_scenario("two_way"))
    scenario, seen = recording.scenario, VIEWS[view]
    scale = seen.noise_scale(np.array(scenario.noise_scale), scenario.game.dynamics)
    exact = observe(seen, scenario.game.dynamics, recording.states)
    noise = sigma * np.random.default_rng(1).standard_normal(exact.shape)
    problem = Problem(scenario.game, seen, sigma, noise_scale=tuple(scale))
    observation = Observation(exact + noise * scale)
    estimate = KktConstrained().estimate(problem, observation, rng=RNG, budget=60)
    assert estimate.converged
    assert estimate.extras["objective"] <= np.sum(noise**2) * (1 + 1e-6)
    assert estimate.states is not None
    positions = np.abs(estimate.states - recording.states)[..., :2]
    assert positions.mean() < 0.5 * sigma


def test_several_trajectories_have_the_optimum_of_the_bilevel_method(seen) -> None:
    problem, observations, _ = seen(1, sigma=0.02, view="partial", count=3)
    joint = KktConstrained().estimate(problem, observations, rng=RNG, budget=60)
    bilevel = Bilevel().estimate(problem, observations, rng=RNG, budget=60)
    assert joint.converged
    assert joint.extras["objective"] == pytest.approx(bilevel.extras["objective"], abs=1e-6)
    np.testing.assert_allclose(joint.weights, bilevel.weights, atol=1e-3)
    single = KktConstrained().estimate(problem, observations[0], rng=RNG, budget=60)
    assert np.trace(joint.covariance) < 0.7 * np.trace(single.covariance)


def test_the_same_trajectory_twice_gives_the_same_weights(seen) -> None:
    problem, (one,), _ = seen(2, sigma=0.02)
    single = KktConstrained().estimate(problem, one, rng=RNG, budget=60)
    twice = KktConstrained().estimate(problem, [one, one], rng=RNG, budget=60)
    np.testing.assert_allclose(twice.weights, single.weights, atol=1e-4)
    np.testing.assert_allclose(twice.covariance, single.covariance / 2, rtol=0.05, atol=1e-7)

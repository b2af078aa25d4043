"""What the built-in estimators refuse, and what they accept."""

import numpy as np
import pytest

from olne_bench.envs.recordings.recording import record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.kkt_constrained import KktConstrained
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.trajectory_fit import fit_trajectory
from olne_bench.games.model.observation import VIEWS
from olne_bench.plugins import ESTIMATOR, PluginError, make, names

RNG = np.random.default_rng(0)
RECORDING = record(get_scenario("two_player"))
GAME = RECORDING.scenario.game
EXTRA = RECORDING.extra_state


def position_error(states: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(states - other)[..., :2].mean())


def estimate(name: str, y: np.ndarray, extra: np.ndarray | None = None):
    problem = Problem(GAME, VIEWS["full"], 0.01)
    return make(ESTIMATOR, name).estimate(problem, Observation(y, extra), rng=RNG, budget=60)


@pytest.mark.parametrize("name", names(ESTIMATOR))
@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda y: y[:-1], r"y has the shape \(24, 2, 4\), expected \(25, 2, 4\)"),
        (lambda y: y[..., :3], r"expected \(25, 2, 4\) for the view 'full'"),
        (lambda y: y[:, :1], r"y has the shape \(25, 1, 4\)"),
        (lambda y: np.where(y == y[3, 0, 0], np.inf, y), "infinite entries"),
    ],
)
def test_an_observation_of_another_problem_is_refused(name, change, expected):
    with pytest.raises(ValueError, match=expected):
        estimate(name, change(RECORDING.states))


@pytest.mark.parametrize("name", names(ESTIMATOR))
def test_an_extra_sample_of_a_wrong_shape_is_refused(name):
    with pytest.raises(ValueError, match=r"extra has the shape \(1, 4\), expected \(2, 4\)"):
        estimate(name, RECORDING.states, EXTRA[:1])


@pytest.mark.parametrize("sigma", [-0.1, np.nan, np.inf])
def test_a_sigma_out_of_range_is_refused(sigma):
    with pytest.raises(ValueError, match="sigma must be a finite number of at least 0"):
        Problem(GAME, VIEWS["full"], sigma)


@pytest.mark.parametrize("floor", [-0.1, 0.25, np.nan])
def test_a_floor_out_of_range_is_refused(floor):
    with pytest.raises(ValueError, match=r"weight_floor must be at least 0 and below 0.25"):
        Problem(GAME, VIEWS["full"], weight_floor=floor)


def test_a_covariance_has_the_noise_scale_on_its_diagonal():
    covariance = np.diag([1.0, 4.0, 0.25, 9.0])
    covariance[0, 1] = covariance[1, 0] = 0.5
    told = Problem(GAME, VIEWS["full"], noise_covariance=covariance)
    assert told.noise_scale == (1.0, 2.0, 0.5, 3.0)
    again = Problem(GAME, VIEWS["full"], noise_covariance=covariance, noise_scale=told.noise_scale)
    assert again == told
    with pytest.raises(ValueError, match="is not the root of the diagonal of noise_covariance"):
        Problem(GAME, VIEWS["full"], noise_covariance=covariance, noise_scale=(1, 4, 0.25, 9))
    with pytest.raises(ValueError, match="noise_covariance must have 4 rows"):
        Problem(GAME, VIEWS["full"], noise_covariance=np.eye(3))


@pytest.mark.parametrize("scale", [(1.0, 1.0), (1, 1, 0, 1), (1, 1, np.nan, 1), (1, 1, -0.1, 1)])
def test_a_noise_scale_out_of_range_is_refused(scale):
    with pytest.raises(ValueError, match="noise_scale must hold 4 positive numbers for the view"):
        Problem(GAME, VIEWS["full"], noise_scale=scale)


@pytest.mark.parametrize("solver", ["ipopt", "structured"])
def test_a_component_of_enormous_noise_is_as_good_as_unseen(solver):
    noise = 0.02 * np.random.default_rng(5).standard_normal(RECORDING.states.shape)
    y, estimator = RECORDING.states + noise, KktConstrained(solver)
    noisy = Problem(GAME, VIEWS["full"], 0.02, noise_scale=(1, 1, 1, 1e6))
    unseen = Problem(GAME, VIEWS["partial"], 0.02)
    first = estimator.estimate(noisy, Observation(y), rng=RNG, budget=60)
    second = estimator.estimate(unseen, Observation(y[..., :3]), rng=RNG, budget=60)
    np.testing.assert_allclose(first.weights, second.weights, atol=1e-4)
    assert first.extras["objective"] == pytest.approx(second.extras["objective"], rel=1e-5)


def test_the_pre_filter_trusts_what_is_seen_well():
    noise = np.random.default_rng(6).standard_normal(RECORDING.states.shape)
    noise *= 0.1 * np.array([1.0, 1.0, 1e-3, 1e-3])
    y = RECORDING.states + noise
    told, untold = (
        fit_trajectory(GAME, VIEWS["full"], y, scale).states for scale in [(1, 1, 1e-3, 1e-3), ()]
    )
    assert position_error(told, RECORDING.states) < 0.7 * position_error(untold, RECORDING.states)


@pytest.mark.parametrize("name", ["kkt_constrained", "kkt_residual"])
@pytest.mark.parametrize("view", ["full", "partial"])
@pytest.mark.parametrize("scenario", ["two_player", "highway_overtaking"])
def test_perfect_observation_recovers_the_weights(name, view, scenario):
    recording = record(get_scenario(scenario))
    game, width = recording.scenario.game, 4 if view == "full" else 3
    observation = Observation(recording.states[..., :width], recording.extra_state[:, :width])
    result = make(ESTIMATOR, name).estimate(
        Problem(game, VIEWS[view]), observation, rng=RNG, budget=60
    )
    assert result.converged
    np.testing.assert_allclose(result.weights, recording.scenario.weights, atol=1e-2)


@pytest.mark.parametrize("name", ["kkt_constrained", "kkt_residual"])
def test_missing_samples_are_no_obstacle(name):
    y = RECORDING.states.copy()
    y[3, 0] = np.nan
    y[10:13, 1, 2] = np.nan
    result = estimate(name, y, EXTRA)
    assert result.converged
    np.testing.assert_allclose(result.weights, RECORDING.scenario.weights, atol=1e-2)


@pytest.mark.parametrize("name", ["kkt_constrained", "kkt_residual"])
def test_weights_lie_on_the_simplex_above_the_floor_and_repeat(name):
    noise = 0.1 * np.random.default_rng(3).standard_normal(RECORDING.states.shape)
    y = RECORDING.states + noise
    y.setflags(write=False)
    first, second = (estimate(name, y, EXTRA) for _ in range(2))
    np.testing.assert_array_equal(first.weights, second.weights)
    np.testing.assert_allclose(first.weights.sum(axis=1), 1, atol=1e-7)
    assert (first.weights >= 1e-5 - 1e-7).all()


def test_the_joint_method_explains_the_data_no_worse_than_the_truth():
    for seed in range(4):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(RECORDING.states.shape)
        result = estimate("kkt_constrained", RECORDING.states + noise)
        assert result.extras["objective"] <= np.sum(noise**2) + 1e-6


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        ("ukf", {"spread": "a"}, "spread must be a number of 1e-06 to 1000, got 'a'"),
        ("ukf", {"spread": float("nan")}, "spread must be a number of 1e-06 to 1000, got nan"),
        ("ukf", {"alpha": float("inf")}, "alpha must be a number of 1e-06 to 1000, got inf"),
        ("particle", {"count": 1}, "count must be an integer of 2 to 1000000, got 1"),
        ("particle", {"count": 20.5}, "count must be an integer of 2 to 1000000, got 20.5"),
        ("particle", {"spread": -1.0}, "spread must be a number of 1e-06 to 1000, got -1.0"),
        ("particle", {"most_draws": True}, "most_draws must be an integer of 1 to 1000000, got T"),
        ("bilevel", {"starts": 0}, "starts must be an integer of 1 to 1000000, got 0"),
        ("bilevel", {"max_evaluations": "9"}, "max_evaluations must be an integer of 1 to 1000000"),
        ("kkt_constrained", {"max_iterations": 0}, "max_iterations must be an integer of 1 to 100"),
        ("kkt_constrained", {"solver": 3}, "unknown solver 3; known are: "),
    ],
)
def test_a_parameter_out_of_range_is_named_with_its_range(name, parameters, expected):
    with pytest.raises(PluginError, match=expected):
        make(ESTIMATOR, name, parameters)

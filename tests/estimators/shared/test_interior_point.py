"""The structured interior-point method against IPOPT, and what it does with bad input."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from olne_bench.envs.scenarios import get_scenario
from olne_bench.estimators.shared.interior_point import solve_joint
from olne_bench.estimators.shared.joint_ipopt import _outcome, solve_joint_ipopt
from olne_bench.estimators.shared.joint_problem import (
    JointPoint,
    JointSettings,
    JointSolution,
    Status,
)
from olne_bench.estimators.shared.trajectory_fit import guess_states
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.observation import VIEWS, ComponentView, View, observe
from olne_bench.games.solve.kkt import kkt_residual_norm
from olne_bench.games.solve.olne import solve_olne


def sequence(
    name: str, view: View, sigma: float, seed: int, **options: int
) -> tuple[Game, np.ndarray, JointPoint]:
    """A game, a noisy observation of its equilibrium, and a start computed from it."""
    scenario = get_scenario(name, 1, **options)
    game = scenario.game
    states = solve_olne(game, scenario.weights, scenario.initial_state).states
    rng = np.random.default_rng(seed)
    y = observe(view, game.dynamics, states)
    y = y + sigma * rng.standard_normal(y.shape)
    return game, y, JointPoint.from_trajectory(game, guess_states(game, view, y))


def is_solution(game: Game, solution: JointSolution, floor: float = 1e-5) -> bool:
    """Whether the constraints hold."""
    point = solution.point
    residual = kkt_residual_norm(game, point.states, point.controls, point.costates, point.weights)
    on_simplex = np.allclose(point.weights.sum(axis=1), 1, atol=1e-9)
    return residual < 1e-8 and on_simplex and bool((point.weights >= floor).all())


@pytest.mark.parametrize("view", VIEWS.values(), ids=VIEWS)
@pytest.mark.parametrize(
    ("name", "options", "sigma"),
    [
        ("two_player", {}, 0.0),
        ("two_player", {}, 0.02),
        ("random", {"num_players": 1}, 0.01),
        ("random", {"num_players": 3}, 0.005),
        ("highway_overtaking", {}, 0.01),
    ],
)
def test_both_back_ends_reach_the_same_optimum(
    name: str, options: dict[str, int], sigma: float, view: View
) -> None:
    game, y, start = sequence(name, view, sigma, seed=4, **options)
    ours, reference = solve_joint(game, view, y, start), solve_joint_ipopt(game, view, [y], [start])
    assert ours.converged, ours.message
    assert reference.converged
    assert is_solution(game, ours)
    # IPOPT relaxes bounds by 1e-8, which lowers its objective by as much.
    assert ours.objective == pytest.approx(reference.objective, rel=1e-5, abs=1e-9)
    np.testing.assert_allclose(ours.point.weights, reference.point.weights, atol=1e-4)


def test_both_back_ends_tie_weights_to_uniform_ones_alike() -> None:
    view = VIEWS["full"]
    game, y, start = sequence("two_player", view, 0.05, seed=4)
    free = solve_joint(game, view, y, start)
    for tie in (0.01, 10.0):
        settings = JointSettings(tie=tie)
        ours = solve_joint(game, view, y, start, settings)
        reference = solve_joint_ipopt(game, view, [y], [start], settings)
        assert ours.converged and reference.converged
        assert ours.objective == pytest.approx(reference.objective, rel=1e-5)
        np.testing.assert_allclose(ours.point.weights, reference.point.weights, atol=1e-4)
        uniform = 1 / game.num_weights
        away = [np.linalg.norm(one.point.weights - uniform) for one in (free, ours)]
        assert away[1] < away[0]
    assert away[1] < 0.01


def test_what_ipopt_says_is_kept_where_it_is_no_code() -> None:
    def told(success: bool, status: str) -> tuple[Status, str]:
        stats = {"success": success, "return_status": status}
        return _outcome(SimpleNamespace(stats=lambda: stats))

    assert told(True, "Solve_Succeeded") == (Status.CONVERGED, "")
    assert told(False, "Maximum_Iterations_Exceeded") == (Status.NO_ITERATIONS, "")
    restored = "Restoration_Failed"
    assert told(False, restored) == (Status.IPOPT_FAILED, restored)


def test_a_run_stops_where_it_comes_close_to_a_known_optimum() -> None:
    view = VIEWS["full"]
    game, y, start = sequence("two_player", view, 0.02, seed=2)
    first = solve_joint(game, view, y, start)
    again = solve_joint(game, view, y, start, known=[first])
    assert not again.converged
    assert again.status is Status.CLOSE_TO_KNOWN
    assert again.iterations < first.iterations
    elsewhere = replace(first, objective=2 * first.objective)
    assert solve_joint(game, view, y, start, known=[elsewhere]).converged


@pytest.mark.parametrize("what", ["huge", "overflowing", "noise", "nothing", "standing still"])
def test_hopeless_data_get_an_honest_answer(what: str) -> None:
    view = VIEWS["full"]
    game, y, _ = sequence("two_player", view, 0.0, seed=0)
    y = {
        "huge": 1e8 * y,
        "overflowing": np.where(np.arange(y.size).reshape(y.shape) == 40, 1e200, y),
        "noise": 10 * np.random.default_rng(0).standard_normal(y.shape),
        "nothing": np.full_like(y, np.nan),
        "standing still": np.zeros_like(y),
    }[what]
    start = JointPoint.from_trajectory(game, guess_states(game, view, y))
    solution = solve_joint(game, view, y, start, JointSettings(max_iterations=100, limit=20.0))
    assert solution.converged == (not solution.message)
    if solution.converged:
        assert is_solution(game, solution)


def test_weights_at_the_bound() -> None:
    """A player without a weight on others, in data with little noise."""
    scenario = get_scenario("two_player")
    game, view = scenario.game, VIEWS["full"]
    weights = np.array([[0.0, 1, 1, 1], [1, 1, 1, 0.0]])
    states = solve_olne(game, weights, scenario.initial_state).states
    rng = np.random.default_rng(0)
    y = states + 0.002 * rng.standard_normal(states.shape)
    solution = solve_joint(game, view, y, JointPoint.from_trajectory(game, y))
    assert solution.converged
    assert is_solution(game, solution)
    assert solution.point.weights.min() < 1e-3


def test_missing_samples_weigh_nothing() -> None:
    view = VIEWS["full"]
    game, y, _ = sequence("two_player", view, 0.0, seed=0)
    y[4:9, 0] = np.nan
    y[:, 1, 2] = np.nan
    start = JointPoint.from_trajectory(game, guess_states(game, view, y))
    solution = solve_joint(game, view, y, start)
    assert solution.converged
    assert solution.objective < 1e-12
    np.testing.assert_allclose(solution.point.weights, 0.25, atol=1e-4)


@pytest.mark.parametrize("horizon", [2, 3])
def test_the_shortest_horizons(horizon: int) -> None:
    scenario = get_scenario("two_player")
    game = replace(scenario.game, horizon=horizon)
    states = solve_olne(game, scenario.weights, scenario.initial_state).states
    y = states + 0.01 * np.random.default_rng(1).standard_normal(states.shape)
    solution = solve_joint(game, VIEWS["full"], y, JointPoint.from_trajectory(game, y))
    assert solution.converged
    assert is_solution(game, solution)


def test_players_in_the_same_place() -> None:
    """Two players with the same start and goal: the outcome must be reported truthfully."""
    scenario = get_scenario("two_player")
    game = replace(scenario.game, players=scenario.game.players[:1] * 2)
    states = solve_olne(scenario.game, scenario.weights, scenario.initial_state).states
    y = states[:, [0, 0]] + 0.01 * np.random.default_rng(1).standard_normal(states.shape)
    solution = solve_joint(game, VIEWS["full"], y, JointPoint.from_trajectory(game, y))
    assert solution.message or is_solution(game, solution)
    assert solution.converged == (not solution.message)


def test_another_motion_model_and_sensor() -> None:
    """Linear motion, one weight per player, positions only."""
    players = tuple(
        Player(
            preferences=(Proximity(), ControlEffort("ax"), ControlEffort("ay")),
            task=(FinalGoal(goal, scale=1.0),),
        )
        for goal in ((1.0, 0.1), (0.0, 1.0))
    )
    game = Game(players, DOUBLE_INTEGRATOR, horizon=15, dt=0.25)
    weights = np.array([[0.2, 0.3, 0.5], [0.4, 0.4, 0.2]])
    initial = np.array([[-1.0, 0.0, 0.3, 0.0], [0.0, -1.0, 0.0, 0.3]])
    truth = solve_olne(game, weights, initial)
    assert truth.certificate.passed
    view = ComponentView("positions", ("px", "py"))
    y = observe(view, game.dynamics, truth.states)
    start = JointPoint.from_trajectory(game, guess_states(game, view, y))
    solution = solve_joint(game, view, y, start)
    assert solution.converged
    assert solution.objective < 1e-12
    np.testing.assert_allclose(solution.point.weights, weights, atol=1e-4)


def test_limits_hold_and_are_told() -> None:
    view = VIEWS["partial"]
    game, y, start = sequence("two_player", view, 0.03, seed=2)
    for limits, status, message in (
        (JointSettings(max_iterations=2), Status.NO_ITERATIONS, "iteration limit reached"),
        (JointSettings(limit=0.0), Status.NO_TIME, "time limit reached"),
    ):
        solution = solve_joint(game, view, y, start, limits)
        assert not solution.converged
        assert (solution.status, solution.message) == (status, message)


def test_a_start_that_is_no_number_is_refused() -> None:
    view = VIEWS["full"]
    game, y, start = sequence("two_player", view, 0.0, seed=0)
    broken = replace(start, states=np.full_like(start.states, np.nan))
    solution = solve_joint(game, view, y, broken)
    assert not solution.converged
    assert solution.status is Status.NOT_FINITE


def test_conditions_without_pivots_are_told() -> None:
    """Nothing penalises the acceleration, so the stage matrices are singular."""
    player = Player(preferences=(ControlEffort("yaw_rate"),))
    scenario = get_scenario("two_player")
    game = replace(scenario.game, players=(player,))
    y = np.zeros((game.horizon, 1, 4))
    solution = solve_joint(game, VIEWS["full"], y, JointPoint.from_trajectory(game, y))
    assert not solution.converged
    assert solution.status is Status.SINGULAR


def test_a_floor_that_no_weights_fulfil_is_refused() -> None:
    view = VIEWS["full"]
    game, y, start = sequence("two_player", view, 0.0, seed=0)
    with pytest.raises(ValueError, match=r"weight_floor must be in \[0, 0.25\)"):
        solve_joint(game, view, y, start, JointSettings(weight_floor=0.25))


def test_iterations_are_those_of_a_second_order_method() -> None:
    """IPOPT needs the same; a wrong derivative would show here first."""
    view = VIEWS["full"]
    game, y, start = sequence("two_player", view, 0.01, seed=3)
    assert solve_joint(game, view, y, start).iterations <= 12


@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.int64])
def test_observations_of_another_type_are_read_as_numbers(dtype: type) -> None:
    view = VIEWS["full"]
    game, y, start = sequence("two_player", view, 0.02, seed=2)
    rough = y.astype(dtype)
    wanted = solve_joint(game, view, rough.astype(float), start)
    found = solve_joint(game, view, rough, start)
    assert found.objective == wanted.objective
    np.testing.assert_array_equal(found.point.weights, wanted.point.weights)
    scattered = np.asfortranarray(rough.astype(float))
    assert solve_joint(game, view, scattered, start).objective == wanted.objective


def test_arrays_of_a_wrong_size_never_reach_the_native_code() -> None:
    view = VIEWS["full"]
    game, y, start = sequence("two_player", view, 0.02, seed=2)
    known = solve_joint(game, view, y, start)
    with pytest.raises(ValueError, match=r"y has the shape \(25, 4\), expected \(25, 8\)"):
        solve_joint(game, view, y[:, :1], start)
    with pytest.raises(ValueError, match=r"theta has the shape \(4,\), expected \(8,\)"):
        solve_joint(game, view, y, replace(start, weights=start.weights[:1]))
    other = replace(known.point, weights=known.point.weights[:, :3])
    with pytest.raises(ValueError, match="theta has the shape"):
        solve_joint(game, view, y, start, known=[replace(known, points=(other,))])
    with pytest.raises(ValueError, match="max_iterations must be 0 to"):
        JointSettings(max_iterations=2**31)

"""The forward game as a function of weights and initial state, for methods that solve it often.

Equilibria are followed from a known root of the first-order conditions (``games.solve.batch``). The
first roots are sought near the observations, so that players pass each other on the observed sides.
The most reliable one is a solution of the joint problem (``kkt_constrained``) with weights tied to
uniform, whose initial state is fitted as well.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from olne_bench.estimators.kkt_residual import residual_weights
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.interior_point import joint_elimination, solve_joint
from olne_bench.estimators.shared.joint_problem import JointPoint
from olne_bench.estimators.shared.joint_starts import largest_explicable
from olne_bench.estimators.shared.trajectory_fit import (
    TrajectoryFit,
    fit_trajectory,
    guess_controls,
    guess_states,
    warm_up_fit,
)
from olne_bench.estimators.shared.window_starts import (
    followed,
    free_drive,
    is_window,
    tied_settings,
    window_points,
)
from olne_bench.games.compiled.elimination import Elimination, elimination
from olne_bench.games.compiled.row_functions import RowFunction
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import View, observation_function
from olne_bench.games.solve.batch import Batch, solve_batch
from olne_bench.games.solve.continuation import follow_coupling
from olne_bench.games.solve.information import observation_sensitivity
from olne_bench.games.solve.kkt import consistent_costates
from olne_bench.games.solve.newton import Root, newton_root
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE
from olne_bench.games.solve.root_following import from_independent_players

#: Factors of the joint problem's term |theta - 1/K|^2, which ties the weights to uniform. With
#: stronger ties, games of five players have to fit by their initial state alone and end at folds,
#: where the equilibrium is not a function of (theta, x_1).
_TIES = (1.0, 10.0)

#: Iterations of the joint problem for a first game.
_MOST_ITERATIONS = 150

#: Its first barrier, and those that are tried where most of the motion is still to come.
_BARRIER, _WINDOW_BARRIERS = 0.1, (1.0, 1e-3)

#: Step of finite differences, relative to a component's noise scale.
_SMALL = 1e-6

#: Least standard deviation of an unobserved heading [rad].
_LEAST_TURN = 0.2

#: Roots this close to each other [m] count as one.
_SAME = 1e-6

#: A motion is that of a root this close to it [m].
_SAME_MOTION = 0.05


@dataclass(frozen=True)
class SolvedGame:
    """A root of the first-order conditions and what it belongs to."""

    root: Root  # the root
    weights: np.ndarray  # (N, K)
    #: (N, U) standardised values of the game's unknowns; None where it has none.
    parameters: np.ndarray | None = None

    @property
    def theta(self) -> np.ndarray:
        """(N, K + U): weights and standardised parameters, as solvers take them."""
        return theta_of(self.weights, self.parameters)

    @property
    def initial_state(self) -> np.ndarray:
        """x_1 (N, n)."""
        return np.asarray(self.root.states[0])


def game_of_point(point: JointPoint) -> SolvedGame:
    """The game of a solution of the joint problem."""
    root = Root(point.states, point.controls, point.costates, residual=0.0)
    return SolvedGame(root, point.weights, point.parameters)


def theta_of(weights: np.ndarray, parameters: np.ndarray | None) -> np.ndarray:
    """(..., N, K + U) of weights (..., N, K) and standardised parameters (..., N, U)."""
    return weights if parameters is None else np.concatenate([weights, parameters], axis=-1)


def warm_up_games(problem: Problem) -> None:
    """Build the solvers that ``first_games`` and ``play_batch`` need."""
    joint_elimination(problem.game, problem.view)
    _ = elimination(problem.game).four
    warm_up_fit(problem.game, problem.view, problem.game.horizon)


def uniform_weights(problem: Problem) -> np.ndarray:
    """(N, K), each 1/K."""
    game = problem.game
    return np.full((game.num_players, game.num_weights), 1 / game.num_weights)


def first_games(problem: Problem, observation: Observation) -> list[SolvedGame]:
    """All different games that are found near an observation, the best fit first.

    Their weights are tied to uniform (``fitted_game``), uniform, those of the residual method
    (``kkt_residual``), or halfway between the last two: at uniform weights there may be no
    equilibrium in which players pass on the observed sides. At fixed weights, Newton's method
    starts at the observations and at the pre-solve (eqn. pre_solve), and further roots come from
    continuation in the coupling between players.
    """
    game, view, y = problem.game, problem.view, observation.y
    fitted = [fitted_game(problem, observation, tie) for tie in _TIES]
    found = [one for one in fitted if one is not None]
    if is_window(y):
        free = free_drive(problem, y)
        guess, fit = free.states, TrajectoryFit(free.states, free.controls, True, "")
    else:
        guess = guess_states(game, view, y)
        fit = fit_trajectory(game, view, y, problem.noise_scale)
    simple = replace(problem, game=replace(game.at_means, constraints=()))
    residual = residual_weights(simple, fit.states, fit.controls)
    uniform = uniform_weights(problem)
    count = game.parameters.count
    means = np.zeros((game.num_players, count)) if count else None
    for weights in (uniform, (uniform + residual) / 2, residual):
        for root in _roots(problem, guess, fit, theta_of(weights, means)):
            new = all(np.abs(root.states - one.root.states).max() > _SAME for one in found)
            if root.residual < RESIDUAL_TOLERANCE and new:
                found.append(SolvedGame(root, weights, means))
    return sorted(found, key=lambda one: squared_error_of(problem, one.root.states, y))


def fitted_game(
    problem: Problem, observation: Observation, tie: float = _TIES[0]
) -> SolvedGame | None:
    """The game that explains an observation best with weights tied to uniform.

    None if none is found. The squared error has the further term ``tie`` |theta - 1/K|^2.
    """
    y = observation.y
    if not is_window(y):
        states = guess_states(problem.game, problem.view, y)
        start = JointPoint.from_trajectory(problem.game, states)
        return _tied_game(problem, y, start, _BARRIER, tie)
    return _fitted_window(problem, y, tie)


def _fitted_window(problem: Problem, y: np.ndarray, tie: float) -> SolvedGame | None:
    """``fitted_game`` where most of the motion is still to come: the best of several starts."""
    points, (high, low) = window_points(problem, y), _WINDOW_BARRIERS
    compared = [
        (followed(problem, y, points.played, tie), _BARRIER),
        (points.seen, high),
        (points.played, high),
    ]
    others = [(points.free, high), (points.played, low), (points.seen, low), (points.free, low)]
    explicable, best, least = largest_explicable(problem, [y]), None, np.inf
    for tried, (start, barrier) in enumerate([*compared, *others]):
        if tried >= len(compared) and least <= explicable:
            break
        found = _tied_game(problem, y, start, barrier, tie)
        error = np.inf if found is None else squared_error_of(problem, found.root.states, y)
        if error < least:
            best, least = found, error
    return best


def _tied_game(
    problem: Problem, y: np.ndarray, start: JointPoint, barrier: float, tie: float
) -> SolvedGame | None:
    """The game to which a start of the tied problem leads, or None."""
    game = problem.game
    settings = replace(tied_settings(problem, tie, _MOST_ITERATIONS), first_barrier=barrier)
    solution = solve_joint(game, problem.view, y, start, settings)
    # With constraints, the tied optimum is often at a kink, where iterations do not settle. Any
    # root nearby will do.
    if not (solution.converged or game.constraints):
        return None
    point = solution.point
    root = newton_root(game, point.states, point.controls, point.costates, point.theta)
    found = SolvedGame(root, point.weights, point.parameters)
    return found if root.residual < RESIDUAL_TOLERANCE else None


def squared_error_of(problem: Problem, states: np.ndarray, y: np.ndarray) -> float:
    """Sum |y - h(x)|^2 over the samples that were seen, in units of their noise scale."""
    return float(np.nansum((expected_samples(problem, states) - scaled_samples(problem, y)) ** 2))


def _roots(
    problem: Problem, guess: np.ndarray, fit: TrajectoryFit, theta: np.ndarray
) -> Iterator[Root]:
    game, weights = problem.game, theta[:, : problem.game.num_weights]
    coasting = np.zeros(game.control_shape)
    if game.constraints:
        for states in (fit.states, guess):
            yield from filter(None, [from_independent_players(game, states[0], coasting, theta)])
        return
    for states, controls in ((guess, coasting), (fit.states, fit.controls)):
        costates = consistent_costates(game.at_means, states, controls, weights)
        if np.isfinite(costates).all():
            yield newton_root(game, states, controls, costates, theta)
    for initial_state in (fit.states[0], guess[0], _calm_start(problem, guess)):
        root = follow_coupling(game, theta, initial_state, coasting)
        if root is not None:
            yield root


def _calm_start(problem: Problem, guess: np.ndarray) -> np.ndarray:
    """x_1 (N, n) whose hidden components are means over a guess's first quarter.

    A speed that is read off two noisy positions can be far beyond any real speed.
    """
    start, hidden = guess[0].copy(), hidden_components(problem)
    start[:, hidden] = guess[: _quarter(guess)][..., hidden].mean(axis=0)
    return np.asarray(start)


def initial_state_prior(
    problem: Problem, observation: Observation, sigma: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (N, n) of x_1 before a filter uses the measurements in turn.

    The mean is read off the first measurements. An observed component has twice the standard
    deviation of one measurement, as the filter uses that measurement again. An unobserved one has
    half its size plus noise; an unobserved heading has a least deviation plus that of the direction
    between two positions at the ends of the first quarter. If a player's first measurements are
    missing, its deviations grow with its possible motion in the meantime.
    """
    guess = guess_states(problem.game, problem.view, observation.y)
    start = _calm_start(problem, guess)
    names, hidden = problem.game.dynamics.state_names, hidden_components(problem)
    noise = sigma * _read_off_noise(problem, observation.y)
    position_noise = noise[:, :2].max(axis=1)
    first = _first_seen(observation.y)
    deviation = 2 * noise
    for i, k in enumerate(first):
        deviation[i] *= 1 + k
        deviation[i, :2] += np.abs(guess[k, i, :2] - guess[0, i, :2]) / 2
    quarter = _quarter(guess)
    for k in hidden:
        one_step = np.sqrt(2) * position_noise / problem.game.dt
        deviation[:, k] = np.abs(start[:, k]) / 2 + one_step / np.sqrt(quarter)
    if "heading" in names and names.index("heading") in hidden:
        way = np.linalg.norm(guess[quarter, :, :2] - guess[0, :, :2], axis=1)
        turned = np.sqrt(2) * position_noise / np.maximum(way, 1e-9)
        deviation[:, names.index("heading")] = np.minimum(_LEAST_TURN + turned, np.pi / 2)
    return start, deviation


def _read_off_noise(problem: Problem, y: np.ndarray) -> np.ndarray:
    """Standard deviations (N, n), relative to sigma, of states read off the first complete samples.

    They come from finite differences of the view's ``read_off``. Hidden components have zero;
    players that were never seen have the largest noise scale.
    """
    dynamics = problem.game.dynamics
    sample = np.array([y[k, i] for i, k in enumerate(_first_seen(y))])
    squared = np.zeros((len(sample), dynamics.state_size))
    for scale, direction in zip(problem.noise_scale, np.eye(sample.shape[1]), strict=True):
        ahead, behind = (
            problem.view.read_off(sample + step * direction, dynamics)
            for step in (_SMALL * scale, -_SMALL * scale)
        )
        for name in ahead:
            slope = (ahead[name] - behind[name]) / (2 * _SMALL)
            squared[:, dynamics.state_names.index(name)] += slope**2
    return np.sqrt(np.where(np.isfinite(squared), squared, max(problem.noise_scale) ** 2))


def _first_seen(y: np.ndarray) -> np.ndarray:
    """(N,) step of each player's first complete sample; zero if it has none."""
    return np.asarray(np.isfinite(y).all(axis=2).argmax(axis=0))


def hidden_components(problem: Problem) -> list[int]:
    """Columns of a state that the view does not show directly."""
    dynamics = problem.game.dynamics
    nothing = np.zeros((1, 1, len(problem.noise_scale)))
    known = problem.view.read_off(nothing, dynamics)
    return [k for k, name in enumerate(dynamics.state_names) if name not in known]


def _quarter(trajectory: np.ndarray) -> int:
    return max(2, len(trajectory) // 4)


def play_batch(
    problem: Problem,
    start: SolvedGame,
    theta: np.ndarray,
    initial_states: np.ndarray,
    *,
    tolerance: float = 1e-10,
    solver: Elimination | None = None,
) -> Batch:
    """Solve a game, by ``solve_batch``, from a root at many theta (B, N, K + U), x_1 (B, N, n)."""
    return solve_batch(
        problem.game,
        theta,
        start.root,
        start.theta,
        initial_states=initial_states,
        tolerance=tolerance,
        solver=solver,
    )


def game_at(game: Game, root: Root, theta: np.ndarray) -> SolvedGame:
    """A root with its theta (N, K + U)."""
    weights, parameters = np.split(theta, [game.num_weights], axis=1)
    return SolvedGame(root, weights, parameters if parameters.size else None)


def game_of_motion(game: Game, states: np.ndarray, theta: np.ndarray) -> SolvedGame | None:
    """The game at theta whose motion states (T, N, n) are; None if they are none of it."""
    controls = guess_controls(game, states)
    costates = consistent_costates(game, states, controls, theta)
    try:
        root = newton_root(game, states, controls, costates, theta)
    except ValueError:
        return None
    moved = np.abs(root.states - states).max()
    return game_at(game, root, theta) if moved < _SAME_MOTION else None


def game_of_batch(problem: Problem, batch: Batch, index: int, theta: np.ndarray) -> SolvedGame:
    """One game of a batch, with its theta (N, K + U)."""
    return game_at(problem.game, batch.root(index), theta)


def expected_samples(problem: Problem, states: np.ndarray) -> np.ndarray:
    """h(x) (..., T, N*d) of states (..., T, N, n), in units of the noise scale."""
    seen = _seen(problem.view, problem.game.dynamics)(states.reshape(-1, states.shape[-1]))
    return scaled_samples(problem, seen.reshape(*states.shape[:-1], -1))


@lru_cache(maxsize=16)
def _seen(view: View, dynamics: Dynamics) -> RowFunction:
    """``observe`` with memory that is bound once: filters ask for thousands of samples."""
    return RowFunction(observation_function(view, dynamics), None)


def scaled_samples(problem: Problem, y: np.ndarray) -> np.ndarray:
    """Samples (..., T, N*d) of observations (..., T, N, d), scaled to noise of deviation sigma."""
    scaled = y / np.array(problem.noise_scale)
    return np.asarray(scaled.reshape(*y.shape[:-2], -1))


def sample_sensitivity(
    problem: Problem, game: SolvedGame, solver: Elimination | None = None
) -> np.ndarray:
    """Derivative (T*N*d, N*(K+U) + N*n) of h(x) in (theta, x_1) at a game; ValueError at a fold."""
    root = game.root
    return observation_sensitivity(
        problem.game,
        problem.view,
        root.states,
        root.controls,
        root.costates,
        game.theta,
        noise_scale=problem.noise_scale,
        solver=solver,
    )

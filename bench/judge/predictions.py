"""Predictions from the samples so far, for weights that come without a motion, and without weights.

The present state is that of the motion with constant controls that explains the latest samples
best. It knows no game. Each prediction is given what is known and the samples (S, N, d) so far, and
gives states (T, N, n); those of past samples are read off them.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from olne_bench.bench.judge.cloned_policy import driven, policy_of
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.trajectory_fit import guess_states
from olne_bench.estimators.shared.window_starts import drive_alone
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.observation import observe
from olne_bench.games.solve.olne import solve_olne

#: Number of latest samples that tell the present state.
_RECENT = 5

#: Pull to what is read off the samples [m per unit], where they leave something open.
_PULL = 1e-2

#: Least noise [m] that drivers are fitted under.
_LEAST_SIGMA = 1e-3

#: Evaluations of the fit, and rounds of best responses of a prediction.
_EVALUATIONS, _ROUNDS = 30, 30


def drive_on(problem: Problem, seen: np.ndarray) -> np.ndarray:
    """Every player goes on as it is, with controls of zero."""
    states, controls = _until_now(problem, seen)
    return _held(problem, states, np.zeros_like(controls))


def turn_on(problem: Problem, seen: np.ndarray) -> np.ndarray:
    """Every player goes on with its present controls: constant acceleration and turning."""
    states, controls = _until_now(problem, seen)
    return _held(problem, states, controls)


def drive_as_cloned(problem: Problem, seen: np.ndarray) -> np.ndarray | None:
    """Every player goes on as players of the simulator did who were where it is now.

    None where no policy was trained.
    """
    policy = policy_of(problem.game)
    if policy is None:
        return None
    states, controls = _until_now(problem, seen)
    ahead = driven(policy, problem.game, states[-1], controls, problem.game.horizon - len(seen))
    return np.concatenate([states[:-1], ahead])


def drive_as_stock(road: str, problem: Problem, seen: np.ndarray) -> np.ndarray:
    """Every player goes on as HighwayEnv's own drivers do, towards its present speed."""
    from olne_bench.envs.roads.stock_drivers import (  # slow, and for roads only
        StockDriver,
        drive_stock,
    )

    states, _ = _until_now(problem, seen)
    drivers = [StockDriver(float(speed)) for speed in states[-1, :, 3]]
    steps = problem.game.horizon - len(seen)
    ahead = drive_stock(road, problem.game, states[-1], drivers, steps)
    return np.concatenate([states[:-1], ahead])


def drive_as_fitted(road: str, problem: Problem, seen: np.ndarray) -> np.ndarray | None:
    """As ``drive_as_stock``, with drivers fitted to the samples so far.

    None before the second sample, as one says nothing about a driver.
    """
    from olne_bench.envs.roads.stock_drivers import predict_by_fit  # slow, and for roads only

    if len(seen) == 1:
        return None
    states, _ = _until_now(problem, seen)
    deviations = max(problem.sigma, _LEAST_SIGMA) * np.asarray(problem.noise_scale)
    deviations = np.broadcast_to(deviations, states.shape[-1:])
    filled = states if seen.shape != states.shape else np.where(np.isnan(seen), states, seen)
    ahead = predict_by_fit(road, problem.game, filled, deviations, problem.game.horizon - len(seen))
    return np.concatenate([states[:-1], ahead])


def play_on(
    problem: Problem, seen: np.ndarray, weights: np.ndarray, parameters: np.ndarray | None = None
) -> np.ndarray | None:
    """What is left of the game at weights (N, K), from the present state; None if none is found.

    Parameters (N, U) are values of the game's unknowns, if it has any.
    """
    game, (states, _) = problem.game, _until_now(problem, seen)
    if parameters is not None:
        game = game.known(parameters)
    left = game.horizon - len(seen)
    if left == 0:
        return states
    rest_of_game = replace(game, horizon=left + 1)
    # From coasting, players would have to find their way round a bend at once.
    plans = drive_alone(rest_of_game, states[-1]).controls
    try:
        rest = solve_olne(
            rest_of_game, weights, states[-1], initial_controls=plans, max_rounds=_ROUNDS
        )
    except ValueError:  # the present state breaks a constraint
        return None
    return np.concatenate([states[:-1], rest.states]) if rest.certificate.passed else None


def _held(problem: Problem, states: np.ndarray, controls: np.ndarray) -> np.ndarray:
    """States (T, N, n): those so far (S, N, n), then controls (N, m) that are held."""
    game = problem.game
    held = np.repeat(controls[None], game.horizon - len(states), axis=0)
    return np.concatenate([states[:-1], rollout(game.dynamics, states[-1], held, game.dt)])


def _until_now(problem: Problem, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What samples (S, N, d) tell: states (S, N, n), the last one fitted, and controls (N, m)."""
    game, view = problem.game, problem.view
    states, recent = guess_states(game, view, seen), seen[-_RECENT:]
    known, steps = np.isfinite(recent), len(recent) - 1
    if steps == 0:
        return states, np.zeros(game.control_shape[1:])
    size = states[0].size
    first = np.concatenate([states[-len(recent)].ravel(), np.zeros(game.control_shape[1:]).ravel()])

    def motion(unknown: np.ndarray) -> np.ndarray:
        start = unknown[:size].reshape(states.shape[1:])
        controls = np.repeat(unknown[size:].reshape(1, *game.control_shape[1:]), steps, axis=0)
        return rollout(game.dynamics, start, controls, game.dt)

    def errors(unknown: np.ndarray) -> np.ndarray:
        missed = observe(view, game.dynamics, motion(unknown)) - recent
        scaled = (missed / np.array(problem.noise_scale))[known]
        return np.concatenate([scaled, _PULL * (unknown - first)])

    found = least_squares(errors, first, max_nfev=_EVALUATIONS)
    controls = found.x[size:].reshape(game.control_shape[1:])
    return np.concatenate([states[:-1], motion(found.x)[-1:]]), controls

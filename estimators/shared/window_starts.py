"""Starts where most of a motion is still to come.

What methods read off samples (``trajectory_fit.guess_states``) goes straight on after them, off any
road that bends, and no game is found near it. Four other motions begin at the samples:

1. the free drive: each player's best plan alone, at uniform weights and from the first state that
   the samples show. A plan for the samples comes first, then the horizon grows by a few steps at a
   time, so that it finds its way round bends. A second plan begins at coasting, as goals may count
   at the end of the horizon only; the cheaper one is taken;
2. the game at uniform weights that iterated best response finds from the free drive;
3. the samples, and from the last of them on the free drive;
4. the game that explains the first two samples best with weights tied to uniform, then more and
   more samples, each solution the next one's start, so that the motion never has to leap.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.interior_point import solve_joint
from olne_bench.estimators.shared.joint_problem import JointPoint, JointSettings, inside
from olne_bench.estimators.shared.trajectory_fit import guess_controls, guess_states, smoothed
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.best_response import (
    LEAST,
    best_responses,
    grown_plans,
    iterated_best_response,
)
from olne_bench.games.solve.continuation import coupled_features
from olne_bench.games.solve.newton import newton_root

#: An observation is a window if some player is not seen after this share of the horizon.
_SHOWN = 0.75

#: Passes of the filter over the samples.
_SMOOTHING = 4

#: Rounds of best responses, and residual of a game.
_ROUNDS, _RESIDUAL = 30, 1e-6

#: Following more and more samples: how many to begin with, how often some are added at most, and
#: tolerance, iterations, and barriers of the first solve and of all others.
_FIRST, _ADDITIONS = 2, 8
_LOOSE, _ITERATIONS, _BARRIERS = 1e-6, 60, (1.0, 1e-2)


def is_window(y: np.ndarray) -> bool:
    """Whether too much is still to come in observations (T, N, d) for straight lines."""
    return bool(_last_seen(y).min() < _SHOWN * len(y))


@dataclass(frozen=True)
class WindowPoints:
    """Points at uniform weights."""

    #: The game that iterated best response finds; the free drive if it finds none.
    played: JointPoint
    seen: JointPoint  # the samples, then the free drive from there
    free: JointPoint  # the free drive


def window_points(problem: Problem, y: np.ndarray) -> WindowPoints:
    """Motions that begin at the samples (T, N, d), NaN where missing."""
    free = free_drive(problem, y)
    return WindowPoints(_played(problem.game, free), seen_then_free(problem, y), free)


def _played(game: Game, free: JointPoint) -> JointPoint:
    """The game at uniform weights near the free drive, or the free drive."""
    if game.constraints:
        return free
    found = iterated_best_response(
        game, free.theta, free.states[0], free.controls, max_rounds=_ROUNDS
    )
    root = newton_root(game, found.states, found.controls, found.costates, free.theta)
    if root.residual > _RESIDUAL:
        return free
    return replace(free, states=root.states, controls=root.controls, costates=root.costates)


def seen_then_free(problem: Problem, y: np.ndarray) -> JointPoint:
    """The samples (T, N, d), smoothed, then each player's best plan alone, without constraints."""
    game, states = problem.game, _shown_states(problem, y)
    if (shown := len(states)) < game.horizon:
        ahead = drive_alone(replace(game, horizon=game.horizon - shown + 1), states[-1])
        states = np.concatenate([states, ahead.states[1:]])
    return JointPoint.from_trajectory(game, states, guess_controls(game, states))


def free_drive(problem: Problem, y: np.ndarray) -> JointPoint:
    """Each player's best plan alone, without constraints, from the first state in y (T, N, d)."""
    states = _shown_states(problem, y)
    return drive_alone(problem.game, states[0], guess_controls(problem.game, states))


def _shown_states(problem: Problem, y: np.ndarray) -> np.ndarray:
    """(S, N, n) states up to the last sample that shows every player, slightly smoothed."""
    shown = max(LEAST, int(_last_seen(y).min()))
    return smoothed(guess_states(problem.game, problem.view, y[:shown]), _SMOOTHING)


def drive_alone(game: Game, start: np.ndarray, first: np.ndarray | None = None) -> JointPoint:
    """Each player's best plan alone, at uniform weights and without constraints, from x_1 (N, n).

    It begins with the controls (S, N, m) of the first steps; zeros if None.
    """
    whole, game = game, replace(game, constraints=())
    point = JointPoint.from_trajectory(game, np.repeat(start[None], game.horizon, axis=0))
    alone = np.where(coupled_features(game), 0.0, point.theta)
    grown = grown_plans(game, start, alone, first)
    plans = np.stack([grown, np.zeros_like(grown)])
    controls, costates = point.controls.copy(), point.costates.copy()
    states = rollout(game.dynamics, start, grown, game.dt)
    for i in range(game.num_players):
        found = best_responses(game, i, plans[:, :, i], states, grown, alone)
        best = int(np.argmin(found.costs))
        controls[:, i], costates[:, i] = found.controls[best], found.costates[best]
    states = rollout(game.dynamics, start, controls, game.dt)
    unknown = JointPoint.from_trajectory(whole, states).parameters  # of constraints as well
    return replace(point, states=states, controls=controls, costates=costates, parameters=unknown)


def tied_settings(problem: Problem, tie: float, iterations: int) -> JointSettings:
    """Settings of a loose solve with terms ``tie`` |theta - 1/K|^2 and ``tie`` |s|^2."""
    return JointSettings(
        noise_scale=problem.noise_scale,
        weight_floor=problem.weight_floor,
        tie=tie,
        parameter_tie=tie,
        tolerance=_LOOSE,
        max_iterations=iterations,
    )


def followed(
    problem: Problem,
    y: np.ndarray,
    start: JointPoint,
    tie: float = 1.0,
    *,
    deadline: float = np.inf,
) -> JointPoint:
    """The last solution with weights tied to uniform, as more and more of y (T, N, d) counts.

    Solves end by the deadline, in seconds of ``time.monotonic``.
    """
    settings = tied_settings(problem, tie, _ITERATIONS)
    point, shown = start, int(_last_seen(y).max())
    growth = max(1, -(-(shown - _FIRST) // _ADDITIONS))
    for count in (*range(_FIRST, shown, growth), shown):
        left = deadline - time.monotonic()
        if left < 0:
            break
        settings = replace(settings, first_barrier=_BARRIERS[int(count > _FIRST)], limit=left)
        part = first_samples(y, count)
        solution = solve_joint(problem.game, problem.view, part, point, settings)
        if solution.converged:
            point = inside(solution.point, problem.weight_floor)
    return point


def first_samples(y: np.ndarray, count: int) -> np.ndarray:
    """Observations (T, N, d) without those after the first ``count``."""
    y = y.copy()
    y[count:] = np.nan
    return y


def _last_seen(y: np.ndarray) -> np.ndarray:
    """(N,) number of samples up to each player's last one; zero if it has none."""
    seen = np.isfinite(y).any(axis=2)
    return np.where(seen.any(axis=0), len(y) - seen[::-1].argmax(axis=0), 0)

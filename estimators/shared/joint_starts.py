"""Starts of the joint problem's structured solver, and when enough of them have been tried.

The first two starts need no other problem to be solved:

1. the observations, slightly smoothed, with the controls that lead from one to the next, at uniform
   weights and under a barrier that keeps them there at first;
2. the observations smoothed more, at weights near a corner of the simplex. In partial views it
   finds optima that no start at uniform weights does.

An optimum whose squared error is larger than any noise of the known level can leave is no answer
while others are left to find. If no optimum was found twice, or two that differ explain the
observations, up to four more starts are tried: the observations with zero controls; the same with a
high barrier, which first centres the weights; and the solution of the problem with weights tied to
uniform, the tie then dropped at once or in two steps. While nothing explains the observations,
starts at weights spread over the simplex follow.

Where most of a motion is still to come, starts begin with motions of ``window_starts``, and the
first one is the game that is followed from sample to sample. Several motions that share weights
start together: with the first two starts of each, and then with the optimum of each by itself.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.interior_point import solve_joint_motions
from olne_bench.estimators.shared.joint_problem import (
    JointPoint,
    JointSettings,
    JointSolution,
    SeenMotion,
    Status,
    inside,
)
from olne_bench.estimators.shared.trajectory_fit import guess_controls, guess_states, smoothed
from olne_bench.estimators.shared.white_noise import assumed_sigma
from olne_bench.estimators.shared.window_starts import followed, is_window, window_points

#: Strength of the tie to uniform weights, relative to a solution's squared error.
_TIE = 0.3

#: First barriers of the structured solver: where it is to stay near its start, where it is to
#: forget it, between the two, and in its first run.
_LOW_BARRIER, _HIGH_BARRIER, _MIDDLE_BARRIER, _FIRST_BARRIER = 1e-3, 10.0, 0.1, 1.0

#: Passes of the filter over the states of the first and of the second start.
_SMOOTHING = 4, 8

#: Weight of the preference in whose corner the second start is.
_CORNER = 0.94

#: Tolerance of a solution that only serves as a start.
_LOOSE = 1e-3

#: Noise leaves a larger squared error than a fit may have with this probability.
_SURPRISE = 1e-6

#: Largest number of starts at weights spread over the simplex.
_MOST_SPREAD = 12


def joint_attempts(
    problem: Problem, y: np.ndarray, settings: JointSettings, deadline: float
) -> Iterator[JointSolution]:
    """Solve for y (T, N, d), NaN where missing, with white noise, until a start suffices.

    The deadline is in seconds of ``time.monotonic``.
    """
    search = Search.of(problem, y, settings, deadline)
    for start, barrier in starts(problem, y, search):
        yield search.attempt(start, barrier)
        if search.settled:
            return
    for start in spread_starts(problem, y):
        if search.explained:
            return
        yield search.attempt(start, _LOW_BARRIER)


def shared_attempts(
    problems: Sequence[Problem],
    search: "Search",
    own: Callable[[Problem, np.ndarray], Sequence[JointSolution]],
) -> Iterator[JointSolution]:
    """Solve the joint problem of several motions with white noise from one start after the other.

    ``own`` are attempts on one motion, given its problem and observations (T, N, d).
    """
    pairs = [(problem, motion.y) for problem, motion in zip(problems, search.motions, strict=True)]
    first = [list(islice(starts(*pair, Search.of(*pair, *search.limits)), 2)) for pair in pairs]
    for row in zip(*first, strict=True):
        yield search.attempt([start for start, _ in row], row[0][1])
    if search.settled:
        return
    best = [lowest(own(*pair)).point for pair in pairs]
    inner = [inside(one, problem.weight_floor) for one, problem in zip(best, problems, strict=True)]
    yield search.attempt(inner, _LOW_BARRIER)
    for row in zip(*(spread_starts(*pair) for pair in pairs), strict=True):
        if search.explained:
            return
        yield search.attempt(row, _LOW_BARRIER)


def lowest(attempts: Sequence[JointSolution]) -> JointSolution:
    """The lowest criterion; a start that did not converge never beats one that did."""
    return min(attempts, key=lambda attempt: (not attempt.converged, attempt.criterion))


def starts(problem: Problem, y: np.ndarray, search: "Search") -> Iterator[tuple[JointPoint, float]]:
    """The starts of the structured solver in turn, each with its first barrier."""
    if not is_window(y):
        yield from _observed_starts(problem, y, search)
        return
    points = window_points(problem, y)
    yield followed(problem, y, points.played, deadline=search.deadline), _LOW_BARRIER
    yield points.seen, _FIRST_BARRIER
    yield points.played, _FIRST_BARRIER
    yield from _cornered(problem, points.seen)
    yield from _tied_starts(points.free, search)


def all_starts(
    problem: Problem, y: np.ndarray, search: "Search"
) -> Iterator[tuple[JointPoint, float]]:
    """Those of ``starts`` and, for windows, those of other observations: to find more optima."""
    yield from starts(problem, y, search)
    if is_window(y):
        yield from _observed_starts(problem, y, search)


def _observed_starts(
    problem: Problem, y: np.ndarray, search: "Search"
) -> Iterator[tuple[JointPoint, float]]:
    game, states = problem.game, guess_states(problem.game, problem.view, y)
    calm, smooth = (smoothed(states, passes) for passes in _SMOOTHING)
    yield JointPoint.from_trajectory(game, calm, guess_controls(game, calm)), _FIRST_BARRIER
    yield from _cornered(
        problem, JointPoint.from_trajectory(game, smooth, guess_controls(game, smooth))
    )
    yield from _tied_starts(JointPoint.from_trajectory(game, states), search)


def _cornered(problem: Problem, point: JointPoint) -> Iterator[tuple[JointPoint, float]]:
    """A motion at weights near a corner of the simplex."""
    corner = _corner(problem.game.num_players, problem.game.num_weights)
    yield inside(replace(point, weights=corner), problem.weight_floor), _LOW_BARRIER


def _tied_starts(start: JointPoint, search: "Search") -> Iterator[tuple[JointPoint, float]]:
    """A motion at uniform weights, at two barriers, and the solutions of tied problems."""
    yield start, _MIDDLE_BARRIER
    best = search.lowest
    tied = search.tied(start, _TIE * best)
    yield tied, _LOW_BARRIER
    yield start, _HIGH_BARRIER
    yield search.tied(tied, 0.1 * _TIE * best, _LOW_BARRIER), _LOW_BARRIER


def spread_starts(problem: Problem, y: np.ndarray) -> Iterator[JointPoint]:
    """The observations at weights and unknowns spread like their priors; the same in every call."""
    game = problem.game
    if is_window(y):
        start = window_points(problem, y).played
    else:
        states = guess_states(game, problem.view, y)
        start = JointPoint.from_trajectory(game, states, guess_controls(game, states))
    random = np.random.default_rng(0)
    for _ in range(_MOST_SPREAD):
        weights = random.dirichlet(np.ones(game.num_weights), game.num_players)
        parameters = start.parameters
        if parameters is not None:
            low, high = game.parameters.bounds()
            parameters = random.standard_normal(parameters.shape).clip(0.9 * low, 0.9 * high)
            parameters = np.where(game.parameters.used, parameters, 0.0)
        spread = replace(start, weights=weights, parameters=parameters)
        yield inside(spread, problem.weight_floor)


def largest_explicable(
    problem: Problem, ys: Sequence[np.ndarray], surprise: float = _SURPRISE
) -> float:
    """The squared error that noise exceeds with probability ``surprise`` in y (T, N, d)."""
    seen = sum(int(np.isfinite(y).sum()) for y in ys)
    return float(assumed_sigma(problem) ** 2 * chdtri(max(1, seen), surprise))


def unexplained(problem: Problem, error: float, ys: Sequence[np.ndarray]) -> str:
    """One line if noise does not explain a squared error of samples (T, N, d); empty if it does."""
    explicable = largest_explicable(problem, ys)
    if error <= explicable:
        return ""
    return (
        f"noise does not explain the squared error of {error:.3g}; it leaves at most "
        f"{explicable:.3g}"
    )


class End(NamedTuple):
    """What a start's optimum minimises, and its squared error; infinite where there is none."""

    criterion: float = np.inf
    error: float = np.inf


class Search:
    """Starts of the structured solver on some motions, where each ended, and the optima so far.

    Solves end by the deadline, in seconds of ``time.monotonic``.
    """

    def __init__(
        self,
        problem: Problem,
        motions: Sequence[SeenMotion],
        settings: JointSettings,
        deadline: float,
    ) -> None:
        """The noise level is that of a problem; noise scales of motions are relative to it."""
        self.motions, self._floor = motions, problem.weight_floor
        self._settings, self.deadline = settings, deadline
        self._explicable = largest_explicable(problem, [one.y for one in motions])
        self.known: list[JointSolution] = []
        self.ends: list[End] = []
        self._last = np.inf

    @classmethod
    def of(
        cls, problem: Problem, y: np.ndarray, settings: JointSettings, deadline: float
    ) -> "Search":
        """A search on one observation (T, N, d)."""
        motion = SeenMotion(problem.game, problem.view, y, problem.noise_scale)
        return cls(problem, [motion], settings, deadline)

    @property
    def limits(self) -> tuple[JointSettings, float]:
        """Settings and deadline."""
        return self._settings, self.deadline

    def attempt(
        self, start: JointPoint | Sequence[JointPoint], barrier: float = _MIDDLE_BARRIER
    ) -> JointSolution:
        """Solve from a start, with a point of each motion; stop close to a known optimum."""
        solution = self._solve(start, replace(self._settings, first_barrier=barrier), self.known)
        if solution.converged:
            self.known.append(solution)
        self.ends.append(self._end(solution))
        self._last = solution.objective
        return solution

    def _end(self, solution: JointSolution) -> "End":
        if solution.status is Status.CLOSE_TO_KNOWN:
            ends = [End(one.criterion, one.objective) for one in self.known]
            return min(ends, key=lambda end: abs(end.criterion - solution.criterion))
        return End(solution.criterion, solution.objective) if solution.converged else End()

    @property
    def lowest(self) -> float:
        """The lowest squared error of an optimum; that of the last start if none led to one."""
        return min((solution.objective for solution in self.known), default=self._last)

    @property
    def explained(self) -> bool:
        """Whether an optimum explains the observations."""
        return any(end.error <= self._explicable for end in self.ends)

    @property
    def settled(self) -> bool:
        """Whether two starts led to one optimum and none to another that could be meant.

        Where one explains the observations, those that do not are not meant.
        """
        explained = [end for end in self.ends if end.error <= self._explicable]
        meant = [end.criterion for end in explained or self.ends]
        same = max(meant) <= min(meant) + 1e-4 * abs(min(meant)) + 1e-12
        return len(meant) > 1 and np.isfinite(max(meant)) and bool(same)

    def tied(self, start: JointPoint, tie: float, barrier: float = _MIDDLE_BARRIER) -> JointPoint:
        """A further start: the solution of the problem with weights tied to uniform."""
        settings = replace(self._settings, tie=tie, parameter_tie=tie)
        settings = replace(settings, first_barrier=barrier, tolerance=_LOOSE)
        solution = self._solve(start, settings, ())
        return inside(solution.point, self._floor)

    def _solve(
        self,
        start: JointPoint | Sequence[JointPoint],
        settings: JointSettings,
        known: Sequence[JointSolution],
    ) -> JointSolution:
        settings = replace(settings, limit=max(0.0, self.deadline - time.monotonic()))
        points = [start] if isinstance(start, JointPoint) else start
        return solve_joint_motions(self.motions, points, settings, known=known)


def _corner(players: int, weights: int) -> np.ndarray:
    """(N, K) weights near the simplex's corner of the last preference."""
    corner = np.full((players, weights), (1 - _CORNER) / max(1, weights - 1))
    corner[:, -1] = _CORNER
    return np.asarray(corner / corner.sum(axis=1, keepdims=True))

"""The joint method as a stream: each solve begins at the solution of the one before.

``kkt_constrained`` and ``map`` start from scratch where there is no last solution, and where the
solve from it does not converge or leaves an error that noise of the known level does not explain.
Where the error is larger than noise leaves once in twenty times, players may pass each other in
another order, so a solve that begins at the samples is tried as well. What the last search left
unexplained is not searched for again, unless the error has become clearly larger.
"""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from olne_bench.estimators.protocol import Estimate, Problem
from olne_bench.estimators.shared.incoming_samples import Past, Samples
from olne_bench.estimators.shared.interior_point import solve_joint
from olne_bench.estimators.shared.joint_problem import (
    JointPoint,
    JointSettings,
    JointSolution,
    inside,
)
from olne_bench.estimators.shared.joint_starts import largest_explicable, lowest
from olne_bench.estimators.shared.white_noise import with_white_noise
from olne_bench.estimators.shared.window_starts import seen_then_free
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game

#: First barriers of a solve from the last solution, and of one from the samples.
_BARRIER, _SEEN_BARRIER = 1e-3, 1.0

#: Noise leaves a larger squared error with this probability.
_DOUBTFUL = 0.05

#: The error, relative to what noise explains, may grow by this factor before another search.
_GROWTH = 1.5

#: Searches for the lowest optimum of a problem (T, N, d), from scratch, until a deadline.
Search = Callable[[Problem, np.ndarray, float], list[JointSolution]]
#: Makes an estimate of a solution and the number of starts that led to it.
Describe = Callable[[Problem, np.ndarray, JointSolution, int, bool], Estimate]


class JointStream:
    """A stream of the joint method."""

    def __init__(
        self,
        samples: Samples,
        settings: Callable[[Problem], JointSettings],
        search: Search,
        describe: Describe,
    ) -> None:
        self._samples, self._describe = samples, describe
        self._optimum = FollowedOptimum(settings, search)
        self._past = Past()

    def update(self, sample: np.ndarray, *, budget: float) -> Estimate:
        """As of ``Stream``; ValueError as ``Samples.add``."""
        deadline = time.monotonic() + budget
        self._samples.add(sample)
        problem, (observation,) = with_white_noise(*self._samples.window())
        dropped = self._samples.dropped
        best, starts = self._optimum.find(problem, observation.y, deadline, dropped)
        late = time.monotonic() > deadline
        estimate = self._describe(problem, observation.y, best, starts, late)
        whole: Estimate = self._past.with_states_of(estimate, self._samples.past)
        return whole


class FollowedOptimum:
    """The optimum of a joint problem whose observations grow."""

    def __init__(self, settings: Callable[[Problem], JointSettings], search: Search) -> None:
        self._settings, self._search = settings, search
        self._last: JointPoint | None = None
        self._dropped = 0
        self._left = 1.0  # error of the last search, relative to what noise explains; one at least

    def find(
        self, problem: Problem, y: np.ndarray, deadline: float, dropped: int = 0
    ) -> tuple[JointSolution, int]:
        """The optimum, and the number of starts of the search for it; zero if there was none.

        The noise is white; y (T, N, d) begins ``dropped`` samples after the last call's first one.
        Solves end by the deadline, in seconds of ``time.monotonic``.
        """
        best, starts = self._warm(problem, y, deadline, dropped - self._dropped), 0
        if best is None:
            attempts = self._search(problem, y, deadline)
            best = lowest(attempts)
            starts = len(attempts)
            explained = best.objective / largest_explicable(problem, [y])
            self._left = max(1.0, _GROWTH * explained) if best.converged else 1.0
        if best.converged:
            self._last, self._dropped = best.point, dropped
        return best, starts

    def _warm(
        self, problem: Problem, y: np.ndarray, deadline: float, gone: int
    ) -> JointSolution | None:
        """The solution to which the last one leads; None if it explains nothing."""
        if self._last is None or gone >= len(self._last.states):
            return None
        best = self._solved(problem, y, _later(problem.game, self._last, gone), _BARRIER, deadline)
        doubtful = self._left * largest_explicable(problem, [y], _DOUBTFUL)
        if best is None or best.objective > doubtful:
            second = self._solved(problem, y, seen_then_free(problem, y), _SEEN_BARRIER, deadline)
            found = [one for one in (best, second) if one is not None]
            best = min(found, key=lambda one: one.criterion, default=None)
        most = self._left * largest_explicable(problem, [y])
        return best if best is not None and best.objective <= most else None

    def _solved(
        self, problem: Problem, y: np.ndarray, start: JointPoint, barrier: float, deadline: float
    ) -> JointSolution | None:
        """The solution to which a start leads; None if it leads to none."""
        settings = replace(
            self._settings(problem),
            first_barrier=barrier,
            limit=max(0.0, deadline - time.monotonic()),
        )
        start = inside(start, problem.weight_floor)
        solution = solve_joint(problem.game, problem.view, y, start, settings)
        return solution if solution.converged else None


def _later(game: Game, point: JointPoint, steps: int) -> JointPoint:
    """The rest of a motion after so many steps, to the end of a game; the last controls go on."""
    states, controls, costates = (
        point.states[steps:],
        point.controls[steps:],
        point.costates[steps:],
    )
    more = game.horizon - len(states)
    if more > 0:
        further = np.repeat(point.controls[-1:], more, axis=0)
        controls = np.concatenate([controls, further])
        costates = np.concatenate([costates, np.repeat(point.costates[-1:], more, axis=0)])
        end = rollout(game.dynamics, point.states[-1], further, game.dt)
        states = np.concatenate([states, end[1:]])
    return replace(point, states=states, controls=controls, costates=costates)

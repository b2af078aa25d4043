"""The paper's joint maximum-likelihood method (Peters et al. 2021, eqn. inverse_approach).

    min_{theta, x, u, lambda}  sum_t |y_t - h(x_t)|^2
    s.t.  G(x, u, lambda; theta) = 0,  sum theta^i = 1,  theta^i >= floor.

Residuals count in units of their noise scale. States (x_1 included), controls, costates and
weights are all unknown. Weights start uniform, which is feasible, and costates at zero. The
problem is not convex: the five-player highway has optima that lie close in objective and far
apart in weights. So it is solved from several starts and the lowest objective wins. Those of the
structured solver cost no solve of another problem:

1. the observations, with the controls that lead from one to the next, at uniform weights;
2. the observations smoothed, at weights near a corner of the simplex: as far from the first as a
   start can be. In partial views it finds optima that no start at uniform weights does.

Where the two end in different objectives there are several optima at hand, and four starts more
are worth their time: the observations with zero controls, the same under a high barrier, which
begins by centring the weights, and the solution of the problem with its weights tied to uniform
by a quadratic term, which is then dropped at once or in two steps.

Several trajectories share one theta (``joint_several``). The covariance of the weights is the
inverse of the Fisher information at the estimate (``games.information``).

IPOPT, the reference, takes three starts: the observations, the pre-solve (eqn. pre_solve), which
is the paper's own start, and the solution of the tied problem.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np

from olne_bench.estimators.forward_model import Played, likelihood_covariance
from olne_bench.estimators.interior_point import CLOSE_TO_KNOWN, joint_elimination, solve_joint
from olne_bench.estimators.joint_ipopt import joint_solver, solve_joint_ipopt
from olne_bench.estimators.joint_problem import JointPoint, JointSolution
from olne_bench.estimators.joint_several import SeveralSolution, solve_several
from olne_bench.estimators.parameters import check_count
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.trajectory_fit import (
    fit_trajectory,
    guess_controls,
    guess_states,
    smoothed,
    warm_up_fit,
)
from olne_bench.estimators.white_noise import white_problem, with_white_noise
from olne_bench.games.newton import Root

_SOLVERS = ("structured", "ipopt")

#: Strength of the tie to uniform weights, relative to a solution's squared error.
_TIE, _IPOPT_TIE = 0.3, 3.0

#: First barriers of the structured solver where it is to stay near its start, or to forget it.
_LOW_BARRIER, _HIGH_BARRIER = 1e-3, 10.0

#: Passes of the filter over the second start's states, and weight of its corner's preference.
_SMOOTHING, _CORNER = 8, 0.94

#: Tolerance of a solution that is but a start.
_LOOSE = 1e-3


@dataclass(frozen=True)
class KktConstrained:
    """Joint estimation of weights and trajectory under the equilibrium conditions.

    Attributes:
        solver: ``structured``, the interior-point method of this project, or ``ipopt``, the
            reference that it is measured against, which takes some twenty times as long.
        max_iterations: iterations per start. A solve takes 5 to 40; one that needs hundreds has
            lost its way, and another start is the better use of the time.

    Raises:
        ValueError: on an unknown solver, or iterations out of range.
    """

    name: ClassVar[str] = "kkt_constrained"
    several: ClassVar[bool] = True
    solver: str = "structured"
    max_iterations: int = 300

    def __post_init__(self) -> None:
        if self.solver not in _SOLVERS:
            raise ValueError(f"unknown solver {self.solver!r}; known are: {', '.join(_SOLVERS)}")
        check_count("max_iterations", self.max_iterations)

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        problem, observations = with_white_noise(problem, observation)
        deadline = time.monotonic() + budget / 2
        if len(observations) > 1:
            best, starts = self._several(problem, observations, deadline), 2
        else:
            attempts = self._attempts(problem, observations[0].y, deadline)
            one, starts = _lowest(attempts), len(attempts)
            best = SeveralSolution((one.point,), one.objective, one.converged, one.message)
        points = best.points
        seen = [np.isfinite(one.y).any(axis=(0, 2)) for one in observations]
        unseen = np.flatnonzero(~np.any(seen, axis=0))
        message = best.message
        if unseen.size:  # the optimum exists, but says nothing about these players
            message = f"never seen, hence not identified: player {', '.join(map(str, unseen))}"
        converged = best.converged and not unseen.size
        games = [
            Played(Root(p.states, p.controls, p.costates, residual=0.0), p.weights) for p in points
        ]
        covariance = None
        if converged:
            structured = self.solver == "structured"
            solver = joint_elimination(problem.game, problem.view) if structured else None
            covariance = likelihood_covariance(problem, observations, games, solver)
        return Estimate(
            weights=points[0].weights,
            states=points[0].states,
            covariance=covariance,
            converged=converged,
            message=message,
            extras={"objective": best.objective, "starts": starts},
        )

    def _attempts(self, problem: Problem, y: np.ndarray, deadline: float) -> list[JointSolution]:
        if self.solver == "ipopt":
            solutions = self._ipopt_attempts(problem, y)
        else:
            solutions = self._structured_attempts(problem, y, deadline)
        attempts = []
        for attempt in solutions:
            attempts.append(attempt)
            if time.monotonic() > deadline:
                break
        return attempts

    def _several(
        self, problem: Problem, observations: Sequence[Observation], deadline: float
    ) -> SeveralSolution:
        """One theta for all: from every trajectory's own optimum, and from the observations."""
        ys = [one.y for one in observations]
        own = [_lowest(self._attempts(problem, y, deadline)).point for y in ys]
        guesses = [
            JointPoint.from_trajectory(problem.game, guess_states(problem.game, problem.view, y))
            for y in ys
        ]
        solutions = [
            solve_several(
                problem.game,
                problem.view,
                ys,
                starts,
                noise_scale=problem.noise_scale,
                weight_floor=problem.weight_floor,
                max_iterations=self.max_iterations,
            )
            for starts in (own, guesses)
        ]
        return min(solutions, key=lambda found: (not found.converged, found.objective))

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        if self.solver == "ipopt":
            joint_solver(problem.game, problem.view, self.max_iterations)
            warm_up_fit(problem.game, problem.view, problem.game.horizon)
        else:
            joint_elimination(problem.game, problem.view)

    def _structured_attempts(
        self, problem: Problem, y: np.ndarray, deadline: float
    ) -> Iterator[JointSolution]:
        game, view = problem.game, problem.view

        def solve(start: JointPoint, **options: Any) -> JointSolution:
            return solve_joint(
                game,
                view,
                y,
                start,
                noise_scale=problem.noise_scale,
                weight_floor=problem.weight_floor,
                max_iterations=self.max_iterations,
                limit=max(0.0, deadline - time.monotonic()),
                **options,
            )

        known: list[JointSolution] = []
        agree = True

        def attempt(start: JointPoint, barrier: float = 0.1) -> JointSolution:
            nonlocal agree
            solution = solve(start, first_barrier=barrier, known=known)
            if solution.converged:
                known.append(solution)
            agree &= solution.converged or solution.message == CLOSE_TO_KNOWN
            return solution

        def released(tied: JointSolution) -> JointPoint:
            return _inside(tied.point, problem.weight_floor)

        states = guess_states(game, view, y)
        smooth = smoothed(states, _SMOOTHING)
        moving = JointPoint.from_trajectory(game, states, guess_controls(game, states))
        corner = JointPoint.from_trajectory(game, smooth, guess_controls(game, smooth))
        corner = replace(corner, weights=_corner(game.num_players, game.num_weights))
        first = attempt(moving)
        yield first
        yield attempt(_inside(corner, problem.weight_floor), _LOW_BARRIER)
        if agree and _same_objective(known):
            return
        start = JointPoint.from_trajectory(game, states)
        yield attempt(start)
        best = min((solution.objective for solution in known), default=first.objective)
        tied = solve(start, tie=_TIE * best, tolerance=_LOOSE)
        yield attempt(released(tied), _LOW_BARRIER)
        yield attempt(start, _HIGH_BARRIER)
        loosened = solve(
            released(tied), tie=0.1 * _TIE * best, first_barrier=_LOW_BARRIER, tolerance=_LOOSE
        )
        yield attempt(released(loosened), _LOW_BARRIER)

    def _ipopt_attempts(self, problem: Problem, y: np.ndarray) -> Iterator[JointSolution]:
        game, view = problem.game, problem.view
        solve = partial(
            solve_joint_ipopt,
            game,
            view,
            y,
            noise_scale=problem.noise_scale,
            weight_floor=problem.weight_floor,
            max_iterations=self.max_iterations,
        )
        start = JointPoint.from_trajectory(game, guess_states(game, view, y))
        first = solve(start)
        yield first
        fit = fit_trajectory(game, view, y, problem.noise_scale)
        yield solve(JointPoint.from_trajectory(game, fit.states, fit.controls))
        tied = solve(start, tie=_IPOPT_TIE * first.objective)
        yield solve(_inside(tied.point, problem.weight_floor))


def _lowest(attempts: list[JointSolution]) -> JointSolution:
    """The lowest objective; a start that did not converge never beats one that did."""
    return min(attempts, key=lambda attempt: (not attempt.converged, attempt.objective))


def _corner(players: int, weights: int) -> np.ndarray:
    """(N, K) weights near the simplex's corner of the last preference."""
    corner = np.full((players, weights), (1 - _CORNER) / max(1, weights - 1))
    corner[:, -1] = _CORNER
    return corner / corner.sum(axis=1, keepdims=True)


def _same_objective(solutions: list[JointSolution]) -> bool:
    """Whether all starts led to one optimum, as far as objectives tell."""
    values = [solution.objective for solution in solutions]
    return bool(values) and max(values) <= min(values) * (1 + 1e-4) + 1e-12


def _inside(point: JointPoint, floor: float) -> JointPoint:
    """The point with its weights clear of their bound, as interior-point methods start there."""
    weights = np.maximum(point.weights, 2 * floor)
    return replace(point, weights=weights / weights.sum(axis=1, keepdims=True))

"""The paper's joint maximum-likelihood method (Peters et al. 2021, eqn. inverse_approach).

    min_{theta, x, u, lambda}  sum_t |y_t - h(x_t)|^2
    s.t.  G(x, u, lambda; theta) = 0,  sum theta^i = 1,  theta^i >= floor.

Residuals count in units of their noise scale. States (x_1 included), controls, costates and
weights are all unknown. Weights start uniform, which is feasible, and costates at zero. The
problem is not convex: the five-player highway has optima with similar objectives but very different
weights. So it is solved from several starts and the lowest objective wins. The first two starts of
the structured solver need no other problem to be solved:

1. the observations, with the controls that lead from one to the next, at uniform weights;
2. the observations smoothed, at weights near a corner of the simplex: as far from the first as a
   start can be. In partial views it finds optima that no start at uniform weights does.

If the two end at different objectives, there are several optima, and four more starts are tried:
the observations with zero controls; the same with a high barrier, which first centres the weights;
and the solution of the problem with weights tied to uniform by a quadratic term, which is then
dropped at once or in two steps.

Several trajectories share one theta (``joint_ipopt``). The covariance of the weights is the
inverse of the Fisher information at the estimate (``games.information``).

IPOPT, the reference, takes three starts: the observations, the pre-solve (eqn. pre_solve), which is
the paper's own start, and the solution of the tied problem. It is also used if there is no
compiler, and if no start of the structured solver converges: that solver inverts G_z, which is
singular if the optimum lies at a fold of the game's roots.

Paper: Peters, Fridovich-Keil, Rubies-Royo, Tomlin, Stachniss, RSS 2021.
Assumes: an equilibrium of the known game, and independent Gaussian noise of known relative size.
Cost: 3 ms for two players, 16 ms for five, 60 ms on roads; through IPOPT some twenty times as much.
Trust: near the statistical limit while the noise is small, in partial views too. At high noise the
    global optimum itself may be far from the truth.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from olne_bench.checks import check_count
from olne_bench.estimators.forward_model import SolvedGame, likelihood_covariance
from olne_bench.estimators.interior_point import joint_elimination, solve_joint
from olne_bench.estimators.joint_ipopt import joint_solver, solve_joint_ipopt
from olne_bench.estimators.joint_problem import JointPoint, JointSettings, JointSolution, Status
from olne_bench.estimators.protocol import Estimate, Observation, Problem
from olne_bench.estimators.trajectory_fit import (
    fit_trajectory,
    guess_controls,
    guess_states,
    smoothed,
    warm_up_fit,
)
from olne_bench.estimators.white_noise import white_problem, with_white_noise
from olne_bench.games.native import NativeElimination
from olne_bench.games.newton import Root

_SOLVERS = ("structured", "ipopt")

#: Strength of the tie to uniform weights, relative to a solution's squared error.
_TIE, _IPOPT_TIE = 0.3, 3.0

#: First barriers of the structured solver where it is to stay near its start, or to forget it.
_LOW_BARRIER, _HIGH_BARRIER = 1e-3, 10.0

#: Passes of the filter over the second start's states, and weight of its corner's preference.
_SMOOTHING, _CORNER = 8, 0.94

#: Tolerance of a solution that only serves as a start.
_LOOSE = 1e-3


@dataclass(frozen=True)
class KktConstrained:
    """Joint estimation of weights and trajectory under the equilibrium conditions.

    Attributes:
        solver: ``structured``, the interior-point method of this project, or ``ipopt``, the
            reference, which takes some twenty times as long.
        max_iterations: iterations per start. A solve takes 5 to 40; if it needs hundreds, another
            start is a better use of the time.

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
            best, starts = _lowest(attempts), len(attempts)
        points = best.points
        seen = [np.isfinite(one.y).any(axis=(0, 2)) for one in observations]
        unseen = np.flatnonzero(~np.any(seen, axis=0))
        message = best.message
        if unseen.size:  # the optimum exists, but says nothing about these players
            message = f"never seen, hence not identified: player {', '.join(map(str, unseen))}"
        converged = best.converged and not unseen.size
        games = [
            SolvedGame(Root(p.states, p.controls, p.costates, residual=0.0), p.weights)
            for p in points
        ]
        covariance = None
        if converged:
            structured = not self._uses_ipopt(problem)
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
        if self._uses_ipopt(problem):
            return _in_time(self._ipopt_attempts(problem, y), deadline)
        attempts = _in_time(self._structured_attempts(problem, y, deadline), deadline)
        if not any(attempt.converged for attempt in attempts) and time.monotonic() < deadline:
            attempts += _in_time(self._ipopt_attempts(problem, y), deadline)
        return attempts

    def _several(
        self, problem: Problem, observations: Sequence[Observation], deadline: float
    ) -> JointSolution:
        """One theta for all, started at each trajectory's own optimum and at the observations."""
        ys = [one.y for one in observations]
        own = [_lowest(self._attempts(problem, y, deadline)).point for y in ys]
        guesses = [
            JointPoint.from_trajectory(problem.game, guess_states(problem.game, problem.view, y))
            for y in ys
        ]
        solutions = [
            solve_joint_ipopt(problem.game, problem.view, ys, starts, self._settings(problem))
            for starts in (own, guesses)
        ]
        return _lowest(solutions)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        problem = white_problem(problem)
        if self._uses_ipopt(problem):
            tolerance = self._settings(problem).tolerance
            joint_solver(problem.game, problem.view, 1, self.max_iterations, tolerance)
            warm_up_fit(problem.game, problem.view, problem.game.horizon)

    def _uses_ipopt(self, problem: Problem) -> bool:
        """Whether IPOPT is used, by choice or because native code is not available."""
        return self.solver == "ipopt" or not isinstance(
            joint_elimination(problem.game, problem.view), NativeElimination
        )

    def _settings(self, problem: Problem) -> JointSettings:
        return JointSettings(
            noise_scale=problem.noise_scale,
            weight_floor=problem.weight_floor,
            max_iterations=self.max_iterations,
        )

    def _structured_attempts(
        self, problem: Problem, y: np.ndarray, deadline: float
    ) -> Iterator[JointSolution]:
        search = _Search(problem, y, self._settings(problem), deadline)
        game, states = problem.game, guess_states(problem.game, problem.view, y)
        smooth = smoothed(states, _SMOOTHING)
        moving = JointPoint.from_trajectory(game, states, guess_controls(game, states))
        corner = JointPoint.from_trajectory(game, smooth, guess_controls(game, smooth))
        corner = replace(corner, weights=_corner(game.num_players, game.num_weights))
        first = search.attempt(moving)
        yield first
        yield search.attempt(_inside(corner, problem.weight_floor), _LOW_BARRIER)
        if search.agree and _same_objective(search.known):
            return
        start = JointPoint.from_trajectory(game, states)
        yield search.attempt(start)
        best = min((solution.objective for solution in search.known), default=first.objective)
        tied = search.tied(start, _TIE * best)
        yield search.attempt(tied, _LOW_BARRIER)
        yield search.attempt(start, _HIGH_BARRIER)
        loosened = search.tied(tied, 0.1 * _TIE * best, _LOW_BARRIER)
        yield search.attempt(loosened, _LOW_BARRIER)

    def _ipopt_attempts(self, problem: Problem, y: np.ndarray) -> Iterator[JointSolution]:
        game, view = problem.game, problem.view

        def solve(start: JointPoint, tie: float = 0.0) -> JointSolution:
            settings = replace(self._settings(problem), tie=tie)
            return solve_joint_ipopt(game, view, [y], [start], settings)

        start = JointPoint.from_trajectory(game, guess_states(game, view, y))
        first = solve(start)
        yield first
        fit = fit_trajectory(game, view, y, problem.noise_scale)
        yield solve(JointPoint.from_trajectory(game, fit.states, fit.controls))
        tied = solve(start, tie=_IPOPT_TIE * first.objective)
        yield solve(_inside(tied.point, problem.weight_floor))


class _Search:
    """Starts of the structured solver on one observation, and the optima found so far.

    Attributes:
        known: the optima.
        agree: whether every start led to an optimum, or close to a known one.
    """

    def __init__(
        self, problem: Problem, y: np.ndarray, settings: JointSettings, deadline: float
    ) -> None:
        self._problem, self._y = problem, y
        self._settings, self._deadline = settings, deadline
        self.known: list[JointSolution] = []
        self.agree = True

    def attempt(self, start: JointPoint, barrier: float = 0.1) -> JointSolution:
        """Solve from a start; stop close to a known optimum."""
        solution = self._solve(start, replace(self._settings, first_barrier=barrier), self.known)
        if solution.converged:
            self.known.append(solution)
        self.agree &= solution.status in (Status.CONVERGED, Status.CLOSE_TO_KNOWN)
        return solution

    def tied(self, start: JointPoint, tie: float, barrier: float = 0.1) -> JointPoint:
        """A further start: the solution of the problem with weights tied to uniform."""
        settings = replace(self._settings, tie=tie, first_barrier=barrier, tolerance=_LOOSE)
        solution = self._solve(start, settings, ())
        return _inside(solution.point, self._problem.weight_floor)

    def _solve(
        self, start: JointPoint, settings: JointSettings, known: Sequence[JointSolution]
    ) -> JointSolution:
        settings = replace(settings, limit=max(0.0, self._deadline - time.monotonic()))
        problem = self._problem
        return solve_joint(problem.game, problem.view, self._y, start, settings, known=known)


def _in_time(solutions: Iterator[JointSolution], deadline: float) -> list[JointSolution]:
    """The first solution, and those after it that begin before the deadline."""
    attempts = []
    for attempt in solutions:
        attempts.append(attempt)
        if time.monotonic() > deadline:
            break
    return attempts


def _lowest(attempts: list[JointSolution]) -> JointSolution:
    """The lowest objective; a start that did not converge never beats one that did."""
    return min(attempts, key=lambda attempt: (not attempt.converged, attempt.objective))


def _corner(players: int, weights: int) -> np.ndarray:
    """(N, K) weights near the simplex's corner of the last preference."""
    corner = np.full((players, weights), (1 - _CORNER) / max(1, weights - 1))
    corner[:, -1] = _CORNER
    return corner / corner.sum(axis=1, keepdims=True)


def _same_objective(solutions: list[JointSolution]) -> bool:
    """Whether all starts led to one objective, hence presumably to one optimum."""
    values = [solution.objective for solution in solutions]
    return bool(values) and max(values) <= min(values) * (1 + 1e-4) + 1e-12


def _inside(point: JointPoint, floor: float) -> JointPoint:
    """The point with its weights moved off their bound, as interior-point methods need it."""
    weights = np.maximum(point.weights, 2 * floor)
    return replace(point, weights=weights / weights.sum(axis=1, keepdims=True))

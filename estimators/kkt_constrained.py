"""The paper's joint maximum-likelihood method (Peters et al. 2021, eqn. inverse_approach).

    min_{theta, x, u, lambda}  sum_t |y_t - h(x_t)|^2
    s.t.  G(x, u, lambda; theta) = 0,  sum theta^i = 1,  theta^i >= floor.

States (x_1 included), controls, costates and weights are all unknown. Weights start uniform, which
is feasible, and costates at zero. The problem is not convex; several starts are taken, and the
lowest objective wins:

1. the observations themselves with zero controls;
2. the same with a smaller barrier to begin with, which lets the weights go to extremes earlier;
3. the pre-solve (eqn. pre_solve), the paper's own start. In partial views it fits its unobserved
   speeds to the noise and can lead astray, where the first does not.

A solve that took few iterations fell straight into its optimum, and further starts nearly always
end there too; so the others are taken only where the first was long or did not converge.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np

from estimators.interior_point import solve_joint
from estimators.joint_ipopt import joint_solver, solve_joint_ipopt
from estimators.joint_problem import JointPoint, JointSolution
from estimators.protocol import Estimate, Observation, Problem
from estimators.trajectory_fit import fit_trajectory, guess_states, warm_up_fit
from games.native import elimination

_SMALL_BARRIER = 0.01

_SOLVERS = ("structured", "ipopt")


@dataclass(frozen=True)
class KktConstrained:
    """Joint estimation of weights and trajectory under the equilibrium conditions.

    Attributes:
        solver: ``structured``, the interior-point method of this project, or ``ipopt``.
        max_iterations: iterations per start. A solve takes 5 to 40; one that needs hundreds has
            lost its way, and another start is the better use of the time.

    Raises:
        ValueError: on an unknown solver.
    """

    name: ClassVar[str] = "kkt_constrained"
    solver: str = "structured"
    max_iterations: int = 300

    def __post_init__(self) -> None:
        if self.solver not in _SOLVERS:
            raise ValueError(f"unknown solver {self.solver!r}; known are: {', '.join(_SOLVERS)}")

    def estimate(
        self,
        problem: Problem,
        observation: Observation,
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        deadline = time.monotonic() + budget / 2
        attempts = []
        for attempt in self._attempts(problem, observation.y, deadline):
            attempts.append(attempt)
            if time.monotonic() > deadline or _is_short(problem, attempts[0]):
                break
        # A start that did not converge never beats one that did.
        best = min(attempts, key=lambda attempt: (not attempt.converged, attempt.objective))
        unseen = np.flatnonzero(~np.isfinite(observation.y).any(axis=(0, 2)))
        message = best.message
        if unseen.size:  # the optimum exists, but says nothing about these players
            message = f"never seen, hence not identified: player {', '.join(map(str, unseen))}"
        return Estimate(
            weights=best.point.weights,
            states=best.point.states,
            converged=best.converged and not unseen.size,
            message=message,
            extras={"objective": best.objective, "starts": len(attempts)},
        )

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        if self.solver == "ipopt":
            for barrier in (0.1, _SMALL_BARRIER):
                joint_solver(problem.game, problem.view, self.max_iterations, barrier)
        else:
            elimination(problem.game, problem.view)
        warm_up_fit(problem.game, problem.view, problem.game.horizon)

    def _attempts(
        self, problem: Problem, y: np.ndarray, deadline: float
    ) -> Iterator[JointSolution]:
        game, view = problem.game, problem.view
        solve = self._back_end(problem, y, deadline)
        guess = JointPoint.from_trajectory(game, guess_states(game, view, y))
        yield solve(guess)
        yield solve(guess, first_barrier=_SMALL_BARRIER)
        fit = fit_trajectory(game, view, y)
        start = JointPoint.from_trajectory(game, fit.states, fit.controls)
        yield solve(start, first_barrier=_SMALL_BARRIER)

    def _back_end(
        self, problem: Problem, y: np.ndarray, deadline: float
    ) -> Callable[..., JointSolution]:
        if self.solver == "ipopt":
            solve = solve_joint_ipopt
        else:
            # The first start may use up all of the time that there is, but no more.
            solve = partial(solve_joint, limit=max(0.0, deadline - time.monotonic()))
        return partial(
            solve,
            problem.game,
            problem.view,
            y,
            weight_floor=problem.weight_floor,
            max_iterations=self.max_iterations,
        )


def _is_short(problem: Problem, first: JointSolution) -> bool:
    """Whether the first start says enough, by a measured rule of thumb."""
    return first.converged and first.iterations <= max(8, 5 * problem.game.num_players - 2)

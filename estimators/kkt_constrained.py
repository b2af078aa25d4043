"""The paper's joint maximum-likelihood method (Peters et al. 2021, eqn. inverse_approach).

    min_{theta, x, u, lambda}  sum_t |y_t - h(x_t)|^2
    s.t.  G(x, u, lambda; theta) = 0,  sum theta^i = 1,  theta^i >= floor.

Residuals count in units of their noise scale. States (x_1 included), controls, costates and
weights are all unknown. Weights start uniform, which is feasible, and costates at zero. The
problem is not convex, so it is solved from three starts and the lowest objective wins:

1. the observations themselves with zero controls;
2. the pre-solve (eqn. pre_solve), the paper's own start. In partial views it fits its unobserved
   speeds to the noise and can lead astray, where the first does not;
3. the solution of the same problem with the weights tied to uniform by a strong quadratic term,
   which is then dropped. It sometimes finds a lower optimum of the five-player highway, whose
   optima lie close in objective and far apart in weights.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from estimators.interior_point import solve_joint
from estimators.joint_ipopt import joint_solver, solve_joint_ipopt
from estimators.joint_problem import JointPoint, JointSolution
from estimators.protocol import Estimate, Observation, Problem, check_observation
from estimators.trajectory_fit import fit_trajectory, guess_states, warm_up_fit
from games.native import elimination

_SOLVERS = ("ipopt", "structured")

#: Strength of the third start's tie, relative to the first solution's squared error.
_TIE = 3.0


@dataclass(frozen=True)
class KktConstrained:
    """Joint estimation of weights and trajectory under the equilibrium conditions.

    Attributes:
        solver: ``ipopt``, or ``structured``, the interior-point method of this project. The
            latter is ten times faster; on the five-player highway it ends in a higher one of
            the many optima more often than IPOPT does, so it is not the default.
        max_iterations: iterations per start. A solve takes 5 to 40; one that needs hundreds has
            lost its way, and another start is the better use of the time.

    Raises:
        ValueError: on an unknown solver.
    """

    name: ClassVar[str] = "kkt_constrained"
    solver: str = "ipopt"
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
        check_observation(problem, observation)
        deadline = time.monotonic() + budget / 2
        attempts = []
        for attempt in self._attempts(problem, observation.y, deadline):
            attempts.append(attempt)
            if time.monotonic() > deadline:
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
            joint_solver(problem.game, problem.view, self.max_iterations)
        else:
            elimination(problem.game, problem.view)
        warm_up_fit(problem.game, problem.view, problem.game.horizon)

    def _attempts(
        self, problem: Problem, y: np.ndarray, deadline: float
    ) -> Iterator[JointSolution]:
        game, view = problem.game, problem.view
        solve = self._back_end(problem, y, deadline)
        guess = JointPoint.from_trajectory(game, guess_states(game, view, y))
        first = solve(guess)
        yield first
        fit = fit_trajectory(game, view, y, problem.noise_scale)
        yield solve(JointPoint.from_trajectory(game, fit.states, fit.controls))
        tied = solve(guess, tie=_TIE * first.objective)
        yield solve(_inside(tied.point, problem.weight_floor))

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
            noise_scale=problem.noise_scale,
            weight_floor=problem.weight_floor,
            max_iterations=self.max_iterations,
        )


def _inside(point: JointPoint, floor: float) -> JointPoint:
    """The point with its weights clear of their bound, as interior-point methods start there."""
    weights = np.maximum(point.weights, 2 * floor)
    return replace(point, weights=weights / weights.sum(axis=1, keepdims=True))

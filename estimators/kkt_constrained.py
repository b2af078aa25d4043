"""The paper's joint maximum-likelihood method (Peters et al. 2021, eqn. inverse_approach).

    min_{theta, x, u, lambda}  sum_t |y_t - h(x_t)|^2
    s.t.  G(x, u, lambda; theta) = 0,  sum theta^i = 1,  theta^i >= floor.

States (x_1 included), controls, costates and weights are all unknown. Weights start uniform, which
is feasible, and costates at zero. The problem is not convex, so it is solved from three starts
and the lowest objective wins:

1. the observations themselves with zero controls;
2. the pre-solve (eqn. pre_solve), the paper's own start. In partial views it fits its unobserved
   speeds to the noise and can lead astray, where the first does not;
3. the solution of the same problem with the weights tied to uniform by a strong quadratic term,
   which is then dropped. It sometimes finds a lower optimum of the five-player highway, whose
   optima lie close in objective and far apart in weights.
"""

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import casadi as ca
import numpy as np

from estimators.protocol import Estimate, Observation, Problem
from estimators.trajectory_fit import (
    fit_trajectory,
    guess_states,
    observation_parameters,
    squared_error,
    warm_up_fit,
)
from games.game import Game
from games.ipopt import QUIET
from games.kkt import kkt_system
from games.observation import View, observation_size

#: Strength of the third start's tie, relative to the first solution's squared error.
_TIE = 3.0


@dataclass(frozen=True)
class KktConstrained:
    """Joint estimation of weights and trajectory under the equilibrium conditions.

    Attributes:
        max_iterations: IPOPT iterations per start. A solve takes 5 to 40; one that needs
            hundreds has lost its way and the other start is the better use of the time.
    """

    name: ClassVar[str] = "kkt_constrained"
    max_iterations: int = 300

    def estimate(
        self,
        problem: Problem,
        observation: Observation,
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        game, view, y = problem.game, problem.view, observation.y
        started = time.monotonic()
        guess = _Start.from_trajectory(
            game, guess_states(game, view, y), np.zeros(game.control_shape)
        )
        attempts = [self._solve(problem, y, guess)]
        if time.monotonic() - started < budget / 4:
            fit = fit_trajectory(game, view, y)
            start = _Start.from_trajectory(game, fit.states, fit.controls)
            attempts.append(self._solve(problem, y, start))
        if time.monotonic() - started < budget / 4:
            tied = self._solve(problem, y, guess, tie=_TIE * attempts[0].objective)
            attempts.append(self._solve(problem, y, tied.end))
        best = min(attempts, key=lambda attempt: (not attempt.converged, attempt.objective))
        return Estimate(
            weights=np.maximum(best.end.weights, 0),  # IPOPT may pass a bound by its tolerance
            states=best.end.states,
            converged=best.converged,
            message="" if best.converged else best.message,
            extras={"objective": best.objective},
        )

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        _joint_solver(problem.game, problem.view, self.max_iterations)
        warm_up_fit(problem.game, problem.view, problem.game.horizon)

    def _solve(
        self, problem: Problem, y: np.ndarray, start: "_Start", tie: float = 0.0
    ) -> "_Attempt":
        solver = _joint_solver(problem.game, problem.view, self.max_iterations)
        lower = np.full(start.point.size, -np.inf)
        lower[-start.weights.size :] = problem.weight_floor
        solution = solver(
            x0=start.point,
            lbx=lower,
            p=np.concatenate([observation_parameters(y), [tie]]),
            lbg=0,
            ubg=0,
        )
        stats = solver.stats()
        return _Attempt(
            end=start.at(np.array(solution["x"]).ravel()),
            objective=float(solution["f"]),
            converged=bool(stats["success"]),
            message=str(stats["return_status"]),
        )


@dataclass(frozen=True)
class _Start:
    """Values of all unknowns, to start from or to end at; shapes as in ``games.kkt``."""

    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    weights: np.ndarray

    @classmethod
    def from_trajectory(cls, game: Game, states: np.ndarray, controls: np.ndarray) -> "_Start":
        """A trajectory with costates at zero and uniform, hence feasible, weights."""
        uniform = np.full((game.num_players, game.num_weights), 1 / game.num_weights)
        return cls(states, controls, np.zeros_like(states[1:]), uniform)

    @property
    def point(self) -> np.ndarray:
        """All unknowns in one vector."""
        parts = (self.states, self.controls, self.costates, self.weights)
        return np.concatenate([part.ravel() for part in parts])

    def at(self, point: np.ndarray) -> "_Start":
        """The same kind of thing read off another vector."""
        parts = (self.states, self.controls, self.costates, self.weights)
        ends = np.cumsum([part.size for part in parts])[:-1]
        pieces = np.split(point, ends)
        shaped = (piece.reshape(part.shape) for piece, part in zip(pieces, parts, strict=True))
        return _Start(*shaped)


@dataclass(frozen=True)
class _Attempt:
    """Where a start led. The objective includes the tie, where there was one."""

    end: _Start
    objective: float
    converged: bool
    message: str


@lru_cache(maxsize=16)
def _joint_solver(game: Game, view: View, max_iterations: int) -> ca.Function:
    system = kkt_system(game)
    count = game.horizon * game.num_players * observation_size(view, game.dynamics)
    y = ca.SX.sym("y", count)
    seen = ca.SX.sym("seen", y.numel())
    sums = [ca.sum1(row) for row in ca.vertsplit(system.weights, game.num_weights)]
    tie = ca.SX.sym("tie")
    uniform = 1 / game.num_weights
    problem = {
        "x": ca.vertcat(system.states, system.controls, system.costates, system.weights),
        "p": ca.vertcat(y, seen, tie),
        "f": squared_error(game, view, system.states, y, seen)
        + tie * ca.sumsqr(system.weights - uniform),
        "g": ca.vertcat(system.residual, ca.vertcat(*sums) - 1),
    }
    options = QUIET | {"ipopt.max_iter": max_iterations, "ipopt.tol": 1e-9}
    return ca.nlpsol("joint", "ipopt", problem, options)

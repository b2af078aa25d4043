"""The paper's joint maximum-likelihood method (Peters et al. 2021, eqn. inverse_approach).

    min_{theta, x, u, lambda}  sum_t |y_t - h(x_t)|^2
    s.t.  G(x, u, lambda; theta) = 0,  sum theta^i = 1,  theta^i >= floor.

States (x_1 included), controls, costates and weights are all unknown. The problem is not convex.
It is solved from two starts, and the lower objective wins: the pre-solve (eqn. pre_solve) as in
the paper, and the observations themselves with zero controls. The second matters in partial views,
where the pre-solve fits its unobserved speeds to the noise. Weights start uniform, which is
feasible, and costates at zero.
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
        deadline = time.monotonic() + budget / 2
        coasting = np.zeros(game.control_shape)
        attempts = [self._solve(problem, y, guess_states(game, view, y), coasting)]
        if time.monotonic() < deadline:
            fit = fit_trajectory(game, view, y)
            attempts.append(self._solve(problem, y, fit.states, fit.controls))
        # A start that did not converge never beats one that did.
        return min(attempts, key=lambda e: (not e.converged, e.extras["objective"]))

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        _joint_solver(problem.game, problem.view, self.max_iterations)
        warm_up_fit(problem.game, problem.view, problem.game.horizon)

    def _solve(
        self, problem: Problem, y: np.ndarray, states: np.ndarray, controls: np.ndarray
    ) -> Estimate:
        game = problem.game
        solver = _joint_solver(game, problem.view, self.max_iterations)
        count = game.num_players * game.num_weights
        costates = np.zeros(states[1:].size)
        start = np.concatenate(
            [states.ravel(), controls.ravel(), costates, np.full(count, 1 / game.num_weights)]
        )
        lower = np.full(start.size, -np.inf)
        lower[-count:] = problem.weight_floor
        solution = solver(x0=start, lbx=lower, p=observation_parameters(y), lbg=0, ubg=0)
        stats = solver.stats()
        point = np.array(solution["x"]).ravel()
        return Estimate(
            weights=point[-count:].reshape(game.num_players, game.num_weights),
            states=point[: states.size].reshape(states.shape),
            converged=bool(stats["success"]),
            message="" if stats["success"] else str(stats["return_status"]),
            extras={"objective": float(solution["f"]), "iterations": int(stats["iter_count"])},
        )


@lru_cache(maxsize=16)
def _joint_solver(game: Game, view: View, max_iterations: int) -> ca.Function:
    system = kkt_system(game)
    count = game.horizon * game.num_players * observation_size(view, game.dynamics)
    y = ca.SX.sym("y", count)
    seen = ca.SX.sym("seen", y.numel())
    sums = [ca.sum1(row) for row in ca.vertsplit(system.weights, game.num_weights)]
    problem = {
        "x": ca.vertcat(system.states, system.controls, system.costates, system.weights),
        "p": ca.vertcat(y, seen),
        "f": squared_error(game, view, system.states, y, seen),
        "g": ca.vertcat(system.residual, ca.vertcat(*sums) - 1),
    }
    options = QUIET | {"ipopt.max_iter": max_iterations, "ipopt.tol": 1e-9}
    return ca.nlpsol("joint", "ipopt", problem, options)

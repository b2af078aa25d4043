"""NashOpt's inverse game as an estimator: parameters whose equilibrium is nearest to what was seen.

    pip install nashopt==1.3.9 qpsolvers==4.13.0
    olne-bench run examples/nashopt.toml --out runs/nashopt

NashOpt (``ParametricGNEP.solve``) minimises over the players' decisions x and the parameters p

    J(x, p) + rho / 2 ||KKT residual(x, p)||^2,

here with controls as x, weights and the initial state as p, and as J the squared distance of the
predicted samples to the seen ones in units of their noise. It gets each player's cost as a JAX
function; JAX has the derivatives. Solver, penalty and tolerance are NashOpt's defaults. It sees
what every estimator sees: no more data, no prior.

L-BFGS-B is slow where the penalty is large, so an estimate depends on when it is stopped. One draw
of ``two_player`` with drawn weights, sensor ``full``, noise 0.05 m: cosine error 0.17 after 2,000
iterations and 0.053 after 20,000; ``kkt_constrained`` 0.0024, equal weights 0.21. Without a warm
start, or with a penalty of 100 or 1e7, it is 0.20 after 2,000.

Paper: Bemporad, NashOpt, a Python library for generalised Nash equilibria and game design, 2025.
Assumes: a known noise level, and no hard constraints or unknowns besides the weights.
Cost: half a minute for 2,000 iterations with two players.
Trust: not unless it ran for long; ``message`` tells the residual that the penalty leaves.
"""

import operator
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import casadi as ca
import jax
import jax.numpy as jnp
import numpy as np

from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.trajectory_fit import fit_trajectory
from olne_bench.games.model.dynamics import numeric_step
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import observation_function
from olne_bench.games.model.stage_costs import stage_costs
from olne_bench.games.model.unknowns import only_weights

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # one of its own dependencies is deprecated
    from nashopt import ParametricGNEP

jax.config.update("jax_enable_x64", True)

#: CasADi's operations in JAX.
_OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda a: a, ca.OP_NEG: operator.neg, ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: 2 * a, ca.OP_INV: lambda a: 1 / a, ca.OP_SQRT: jnp.sqrt,
    ca.OP_LOG: jnp.log, ca.OP_EXP: jnp.exp, ca.OP_SIN: jnp.sin, ca.OP_COS: jnp.cos,
    ca.OP_TAN: jnp.tan, ca.OP_TANH: jnp.tanh, ca.OP_ATAN: jnp.arctan, ca.OP_ATAN2: jnp.arctan2,
    ca.OP_ADD: operator.add, ca.OP_SUB: operator.sub, ca.OP_MUL: operator.mul,
    ca.OP_DIV: operator.truediv,
}  # fmt: skip


class JaxGame:
    """Rollout and costs of a game as JAX functions of decisions: players' controls, one by one."""

    def __init__(self, game: Game) -> None:
        self.steps, self.players, self.controls = game.control_shape
        self._step = in_jax(numeric_step(game.dynamics, game.dt))
        costs = stage_costs(game)
        self._running, self._final = in_jax(costs.running), in_jax(costs.final)

    def played(self, decisions: Any, first: Any, theta: Any) -> tuple[Any, Any]:
        """States (T, N n) that controls lead to, and each player's cost (N,).

        Args:
            decisions: (N (T-1) m,) all controls of a player, then those of the next one.
            first: (N n,) the initial state.
            theta: (N K,) weights.
        """
        # (N, T-1, m) -> (T-1, N m): CasADi's columns are players
        plans = decisions.reshape(self.players, self.steps, self.controls).transpose(1, 0, 2)

        def advance(state: Any, plan: Any) -> tuple[Any, Any]:
            moved = zip(jnp.split(state, self.players), jnp.split(plan, self.players), strict=True)
            following = jnp.concatenate([self._step(one, control) for one, control in moved])
            return following, (following, self._running(state, plan, theta))

        last, (states, paid) = jax.lax.scan(advance, first, plans.reshape(self.steps, -1))
        return jnp.vstack([first[None], states]), paid.sum(axis=0) + self._final(last, theta)


@dataclass(frozen=True)
class NashOptInverse:
    """NashOpt's inverse game, from equal weights and a smoothed trajectory.

    Attributes:
        penalty: NashOpt's ``rho``.
        max_iterations: largest number of iterations of L-BFGS-B.
        warm_start: NashOpt's ``gne_warm_start``: an equilibrium is found before anything is fitted.
    """

    name: ClassVar[str] = "nashopt_inverse"
    penalty: float = 1e5
    max_iterations: int = 2000
    warm_start: bool = True

    def estimate(
        self,
        problem: Problem,
        observation: Observation,
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Any:
        game = JaxGame(problem.game)
        shape = (problem.game.num_players, problem.game.num_weights)
        count = int(np.prod(shape))
        begin = fit_trajectory(problem.game, problem.view, observation.y, problem.noise_scale)
        first = begin.states[0].ravel()

        def cost_of(i: int) -> Callable[[Any, Any], Any]:
            return lambda x, p: game.played(x, p[count:], p[:count])[1][i]

        solver = ParametricGNEP(
            [game.steps * game.controls] * game.players,
            f=[cost_of(i) for i in range(game.players)],
            npar=count + len(first),
        )
        found = solver.solve(
            J=_distance(problem, observation, game, count),
            pmin=np.r_[np.full(count, problem.weight_floor), first - np.inf],
            pmax=np.r_[np.ones(count), first + np.inf],
            p0=np.r_[np.full(count, 1 / shape[1]), first],
            x0=begin.controls.transpose(1, 0, 2).ravel(),
            rho=self.penalty,
            gne_warm_start=self.warm_start,
            maxiter=self.max_iterations,
            refine_gne=False,
            verbose=False,
        )
        weights = np.asarray(found.p)[:count].reshape(shape)
        residual = float(np.abs(np.asarray(found.res)).max())
        return SimpleNamespace(
            weights=weights / weights.sum(axis=1, keepdims=True),
            converged=bool(np.isfinite(residual)),
            message=f"largest KKT residual {residual:.2g}",
        )

    def supports(self, problem: Problem) -> str | None:
        """Why this problem cannot be solved, or None."""
        if problem.game.constraints:
            return "hard constraints are not in this example"
        return only_weights(problem.game.parameters)


def _distance(
    problem: Problem, observation: Observation, game: JaxGame, count: int
) -> Callable[[Any, Any], Any]:
    """NashOpt's J: squared distance of predicted to seen samples, in units of their noise."""
    view = in_jax(observation_function(problem.view, problem.game.dynamics))
    seen = np.isfinite(observation.y)
    samples = jnp.asarray(np.where(seen, observation.y, 0.0))
    scale = jnp.asarray(np.where(seen, 1 / np.asarray(problem.noise_scale), 0.0))
    noise = max(problem.sigma, 1e-3)

    def distance(x: Any, p: Any) -> Any:
        states, _ = game.played(x, p[count:], p[:count])
        each = states.reshape(-1, states.shape[1] // game.players)
        expected = jax.vmap(view)(each).reshape(samples.shape)
        return jnp.sum(((expected - samples) * scale / noise) ** 2)

    return distance


def in_jax(function: ca.Function) -> Callable[..., Any]:
    """A CasADi function of dense arguments and one dense result, on flat JAX arrays.

    Raises:
        ValueError: when it is called, on an operation that is not known here.
    """

    def evaluate(*arguments: Any) -> Any:
        work: list[Any] = [0.0] * function.sz_w()
        result: list[Any] = [0.0] * function.nnz_out(0)
        for k in range(function.n_instructions()):
            code, into = function.instruction_id(k), function.instruction_output(k)
            inputs = function.instruction_input(k)
            if code == ca.OP_INPUT:
                work[into[0]] = arguments[inputs[0]][inputs[1]]
            elif code == ca.OP_OUTPUT:
                result[into[1]] = work[inputs[0]]
            elif code == ca.OP_CONST:
                work[into[0]] = function.instruction_constant(k)
            elif code in _OPERATIONS:
                work[into[0]] = _OPERATIONS[code](*(work[place] for place in inputs))
            else:
                raise ValueError(f"{function.name()} has an operation without JAX form: {code}")
        return jnp.stack([jnp.asarray(entry, dtype=float) for entry in result])

    return evaluate

"""The forward game solved by NashOpt (extra ``peers``), with exactly this project's costs.

NashOpt needs each player's cost as a JAX function of all decisions. CasADi's functions are lists of
scalar instructions, which are executed on JAX scalars. A scan over the steps rolls out the controls
(single shooting). JAX computes the derivatives.
"""

import operator
import warnings
from collections.abc import Callable
from typing import Any

import casadi as ca
import jax
import jax.numpy as jnp
import numpy as np

from olne_bench.games.model.dynamics import numeric_step
from olne_bench.games.model.game import Game
from olne_bench.games.model.stage_costs import stage_costs

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # one of its own dependencies is deprecated
    from nashopt import GNEP

jax.config.update("jax_enable_x64", True)

#: CasADi's operations in JAX.
_OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda a: a, ca.OP_NEG: operator.neg, ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: 2 * a, ca.OP_INV: lambda a: 1 / a, ca.OP_SQRT: jnp.sqrt,
    ca.OP_LOG: jnp.log, ca.OP_EXP: jnp.exp, ca.OP_SIN: jnp.sin, ca.OP_COS: jnp.cos,
    ca.OP_TAN: jnp.tan, ca.OP_ATAN: jnp.arctan,
    ca.OP_ADD: operator.add, ca.OP_SUB: operator.sub, ca.OP_MUL: operator.mul,
    ca.OP_DIV: operator.truediv,
}  # fmt: skip


class NashOptForward:
    """One forward game, whose decisions are the controls of all players."""

    def __init__(self, game: Game, weights: np.ndarray, initial_state: np.ndarray) -> None:
        steps, players, controls = game.control_shape
        step_one = _in_jax(numeric_step(game.dynamics, game.dt))

        def step(states: Any, plan: Any) -> Any:
            moved = zip(jnp.split(states, players), jnp.split(plan, players), strict=True)
            return jnp.concatenate([step_one(state, control) for state, control in moved])

        costs = stage_costs(game)
        running, final = _in_jax(costs.running), _in_jax(costs.final)
        theta = jnp.asarray(weights.ravel())

        def cost_of(i: int) -> Callable[[Any], Any]:
            def cost(decisions: Any) -> Any:
                # (N, T-1, m) -> (T-1, N m): CasADi's columns are players
                plans = decisions.reshape(players, steps, controls).transpose(1, 0, 2)

                def advance(state: Any, plan: Any) -> tuple[Any, Any]:
                    return step(state, plan), running(state, plan, theta)[i]

                first = jnp.asarray(initial_state.ravel())
                last, paid = jax.lax.scan(advance, first, plans.reshape(steps, -1))
                return paid.sum() + final(last, theta)[i]

            return cost

        sizes = [steps * controls] * players
        self.problem = GNEP(sizes, f=[cost_of(i) for i in range(players)])
        self.shape = (players, steps, controls)

    def solve(self, controls: np.ndarray) -> tuple[np.ndarray, float]:
        """Solve from controls (T-1, N, m); return the controls found and their largest residual."""
        start = np.ascontiguousarray(controls.transpose(1, 0, 2)).ravel()
        found = self.problem.solve(start, verbose=0)
        plans = np.asarray(found.x).reshape(self.shape).transpose(1, 0, 2)
        return plans, float(np.abs(np.asarray(found.res)).max())


def _in_jax(function: ca.Function) -> Callable[..., Any]:
    """A CasADi function of dense arguments and one dense result, on flat JAX arrays."""

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

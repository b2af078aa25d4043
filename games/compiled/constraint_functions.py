"""One step of the constraints, as CasADi functions of the players that a constraint looks at.

With the margins g(x, u) >= 0 of a step and J = dg/d(x, u), the interior point method needs

    margins     g
    push        J' v                      what multipliers v add to the first-order conditions
    change      J d                       how the margins change along a direction d
    condensed   J' diag(sigma) J - sum_k v_k g_k''      what remains of them in the stage blocks

Constraints of one kind (the same formula for other players and numbers) share their functions. In
the last step, where there is no control, each has a second set of them.
"""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from olne_bench.games.compiled.stage_patterns import Pattern, named_functions, stack
from olne_bench.games.model.constraints import Constraint, constraint_stage
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.numbers import numbers_of, with_symbols

#: Functions of a constraint, in the order of ``stages.c``.
CONSTRAINT_FUNCTIONS = ("margins", "push", "change", "condensed")


@dataclass(frozen=True, eq=False)
class ConstraintFunctions:
    """The margins of constraints of one kind in one step, and their derivatives.

    Functions take (states of the players that it looks at (count*n,), control (m,), numbers (P,),
    multipliers v (c,), weights sigma (c,), direction d (count*n + m,)) and return one column. In
    the last step, m is 0.
    """

    needs_control: tuple[bool, ...]  # (c,) whether each margin depends on the control
    num_numbers: int  # P
    functions: dict[str, ca.Function]  # by the names of ``CONSTRAINT_FUNCTIONS``
    #: Where the nonzeros of ``condensed`` sit, rows and columns of the constraint.
    blocks: tuple[Pattern, ...]

    @property
    def num_margins(self) -> int:
        """The number of margins, c."""
        return len(self.needs_control)


@dataclass(frozen=True, eq=False)
class ConstraintPlace:
    """Where one constraint belongs in the whole game."""

    kind: int  # index of its pair of functions (in every step but the last, in the last)
    players: tuple[int, ...]  # those whose states it looks at; the first one's control
    first_step: int  # the first step in which it is enforced
    offset: int  # place of its first margin among all margins of a step
    #: For each of the pair (``jacobian``, ``final_jacobian``), the places of the nonzeros of
    #: ``condensed`` among the values of the stage blocks.
    indices: dict[str, np.ndarray]


def kind_of(constraint: Constraint) -> Constraint:
    """The same formula for the first players, whichever they are, in every step."""
    copy: Any = object.__new__(type(constraint))
    copy.__dict__.update(constraint.__dict__)
    copy.__dict__.update(players=tuple(range(len(constraint.players))), first_step=0)
    kind: Constraint = copy
    return kind


def constraint_functions(
    kind: Constraint, dynamics: Dynamics
) -> tuple[ConstraintFunctions, ConstraintFunctions]:
    """The functions of a kind in every step but the last, and in the last."""
    return _functions(kind, dynamics, last=False), _functions(kind, dynamics, last=True)


def _functions(kind: Constraint, dynamics: Dynamics, *, last: bool) -> ConstraintFunctions:
    numbers = ca.SX.sym("numbers", 1 + len(numbers_of(kind)))
    stage = constraint_stage(kind, dynamics, numbers[0], last=last)
    states = ca.vertcat(*stage.states)
    control = ca.SX(0, 1) if stage.control is None else stage.control
    margins = ca.densify(ca.SX(with_symbols(kind, numbers[1:]).margins(stage)))
    count = margins.numel()
    motion = ca.vertcat(states, control)
    v, sigma = ca.SX.sym("v", count), ca.SX.sym("sigma", count)
    direction = ca.SX.sym("d", motion.numel())

    slope = ca.jacobian(margins, motion)
    curvature = ca.hessian(ca.dot(v, margins), motion)[0]
    condensed = slope.T @ ca.diag(sigma) @ slope - curvature
    x, u = slice(0, states.numel()), slice(states.numel(), motion.numel())
    blocks, values = stack(
        Q=condensed[x, x], P=condensed[x, u], S=condensed[u, x], R=condensed[u, u]
    )
    results = {"margins": margins, "push": slope.T @ v, "change": slope @ direction}
    results["condensed"] = values
    arguments = [states, control, numbers, v, sigma, direction]
    functions = named_functions(CONSTRAINT_FUNCTIONS, arguments, results)
    needs = tuple(bool(ca.depends_on(margins[k], control)) for k in range(count))
    return ConstraintFunctions(needs, numbers.numel(), functions, blocks)

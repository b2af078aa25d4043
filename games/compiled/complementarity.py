"""Hard constraints as equations: relaxed complementarity, stage by stage.

With margins g >= 0 and multipliers v >= 0, g v = 0 becomes g v = tau for a small tau, and that
together with the signs one smooth equation (Fischer, Burmeister; smoothed by Kanzow 1996):

    (C1)  phi(g, v) = g + v - sqrt(g^2 + v^2 + 2 tau) = 0   <=>   g > 0,  v > 0,  g v = tau.

Multipliers are unknowns of a stage as controls are, and the rows phi follow those of the controls.
A margin that depends on the states alone is taken after the step, so that the last state needs no
stage of its own:

    (C2)  h_t = g(x_t, u_t)  where g depends on the control,  g(f(x_t, u_t))  elsewhere,
          L_t^i <- L_t^i - v' h_t   for all players that the constraint looks at.

The costates lambda_t then leave out J' v of the constraints at x_{t+1}.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from olne_bench.games.compiled.stage_patterns import Pattern, half, named_functions, nonzeros, stack
from olne_bench.games.model.constraints import Constraint
from olne_bench.games.model.costs import Stage
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.numbers import numbers_of, with_symbols
from olne_bench.games.model.unknowns import unknowns_of, with_unknowns

#: tau of (C1): what margin times multiplier comes to, in place of zero.
RELAXATION = 1e-9

#: Functions of a constraint, in the order of ``stages.c``.
COMPLEMENTARITY_FUNCTIONS = ("value", "jacobian", "hessian", "margins")


@dataclass(frozen=True, eq=False)
class ComplementarityPlace:
    """Where one constraint belongs in the whole game."""

    kind: int  # index of its functions
    players: tuple[int, ...]  # those whose states it looks at
    first_step: int  # the first step in which it is enforced
    offset: int  # place of its first multiplier among all of a stage
    theta: np.ndarray  # places of its unknowns in theta
    #: For each function but ``margins``, the place of each of its nonzeros among the values of
    #: the whole stage.
    indices: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class ComplementarityFunctions:
    """What constraints of one kind add to the rows of a stage.

    Functions take (states of the players that it looks at (count*n,), their controls (count*m,),
    multipliers v (c,), which margins are enforced (c,), numbers (P,), tau (1,), standardised values
    of its unknowns (k,), and multipliers of the rows (count*n,) and (count*m + c,)), and return one
    column of nonzeros; ``margins`` those of (C2).
    """

    after: tuple[bool, ...]  # (c,) whether each margin is taken after the step
    num_numbers: int  # P
    functions: dict[str, ca.Function]  # by the names of ``COMPLEMENTARITY_FUNCTIONS``
    #: Of all but ``margins``, the blocks of the nonzeros, in rows and columns of the
    #: constraint: states, then controls and multipliers, then unknowns.
    patterns: dict[str, tuple[Pattern, ...]]

    @property
    def num_margins(self) -> int:
        """The number of margins, c."""
        return len(self.after)


def complementarity_functions(kind: Constraint, dynamics: Dynamics) -> ComplementarityFunctions:
    """The functions of a kind (``constraint_functions.kind_of``)."""
    count, n, m = len(kind.players), dynamics.state_size, dynamics.control_size
    states = [ca.SX.sym(f"x{k}", n) for k in range(count)]
    controls = [ca.SX.sym(f"u{k}", m) for k in range(count)]
    numbers = ca.SX.sym("numbers", 1 + len(numbers_of(kind)))
    names = [unknown.name for unknown in unknowns_of(kind)]
    unknowns = ca.SX.sym("s", len(names))
    written: Constraint = with_unknowns(
        with_symbols(kind, numbers[1:]),
        lambda unknown: unknown.value(unknowns[names.index(unknown.name)]),
    )
    margins, after = _margins(written, dynamics, states, controls, numbers)
    size = len(after)
    v, on, tau = ca.SX.sym("v", size), ca.SX.sym("on", size), ca.SX.sym("tau")
    x, u = ca.vertcat(*states), ca.vertcat(*controls)
    inputs = ca.vertcat(u, v)
    p, q = ca.SX.sym("p", x.numel()), ca.SX.sym("q", inputs.numel())

    pushed = ca.dot(v * on, margins)
    g_x, g_u = -ca.gradient(pushed, x), -ca.gradient(pushed, u)
    rows = ca.vertcat(g_u, _smooth(on * margins + (1 - on), v, tau))
    jacobian = stack(
        Q=ca.jacobian(g_x, x),
        P=ca.jacobian(g_x, inputs),
        X=ca.jacobian(g_x, unknowns),
        S=ca.jacobian(rows, x),
        R=ca.jacobian(rows, inputs),
        U=ca.jacobian(rows, unknowns),
    )
    value = nonzeros("G", ca.vertcat(g_x, rows))
    total = ca.dot(p, g_x) + ca.dot(q, rows)
    hessian = nonzeros("H", half(ca.hessian(total, ca.vertcat(x, inputs, unknowns))[0]))
    arguments = [x, u, v, on, numbers, tau, unknowns, p, q]
    found = {"value": value[1], "jacobian": jacobian[1], "hessian": hessian[1]}
    found["margins"] = margins
    return ComplementarityFunctions(
        after=after,
        num_numbers=numbers.numel(),
        functions=named_functions(COMPLEMENTARITY_FUNCTIONS, arguments, found),
        patterns={"value": (value[0],), "jacobian": jacobian[0], "hessian": (hessian[0],)},
    )


def _margins(
    kind: Constraint, dynamics: Dynamics, states: list[ca.SX], controls: list[ca.SX], numbers: ca.SX
) -> tuple[ca.SX, tuple[bool, ...]]:
    """The margins h of (C2), and which of them are taken after the step."""
    dt = numbers[0]
    moved = [dynamics.step(x, u, dt) for x, u in zip(states, controls, strict=True)]
    now = ca.SX(kind.margins(Stage(0, tuple(states), controls[0], dynamics, dt)))
    then = ca.vertsplit(ca.SX(kind.margins(Stage(0, tuple(moved), None, dynamics, dt))))
    margins, after = [], []
    for margin in ca.vertsplit(now):
        state_only = not ca.depends_on(margin, controls[0])
        margins.append(then.pop(0) if state_only else margin)
        after.append(state_only)
    return ca.densify(ca.vertcat(*margins)), tuple(after)


def _smooth(g: ca.SX, v: ca.SX, tau: ca.SX) -> ca.SX:
    """Phi of (C1); where g + v > 0, in the form without cancellation."""
    root = ca.sqrt(g**2 + v**2 + 2 * tau)
    without = 2 * (g * v - tau) / ca.fmax(g + v + root, 1e-30)
    return ca.if_else(g + v > 0, without, g + v - root)

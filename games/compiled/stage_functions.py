"""One stage of the first-order conditions, as CasADi functions of one player or of a pair.

The stacked system G of ``games.solve.kkt`` repeats the same expressions at every step. With
z_t = (x_t, u_t, lambda_t), where lambda_t belongs to the step from t to t+1, its rows are

    rx_t = g_x(x_t, u_t, lambda_t, theta) + lambda_{t-1}    t = 2..T-1   (grad_{x^i} L^i)
    ru_t = g_u(x_t, u_t, lambda_t, theta)                   t = 1..T-1   (grad_{u^i} L^i)
    rf_t = x_{t+1} - f(x_t, u_t)                            t = 1..T-1   (F)
    rx_T = g_T(x_T, theta) + lambda_{T-1}

so a handful of small functions of one stage says all there is to say about a whole game. They are
sums over the terms of ``games.compiled.terms``: functions of one player and of a pair of players,
derived once, which take the numbers of a game (targets, lanes, dt) as an argument. First
derivatives are the nonzeros of named blocks and, for the inverse problem, there are second
derivatives of

    l_t = loss(x_t; y_t) + p' g_x + q' g_u - r' f           (p, q, r: multipliers of rx, ru, rf).

The blocks of one stage, all of them taken at (x_t, u_t, lambda_t, theta):

    Q = d g_x/dx   P = d g_x/du   X = d g_x/dtheta   A = df/dx
    S = d g_u/dx   R = d g_u/du   U = d g_u/dtheta   B = df/du     (dg_x/dlambda = -A', ...)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled.complementarity import (
    ComplementarityFunctions,
    ComplementarityPlace,
    complementarity_functions,
)
from olne_bench.games.compiled.constraint_functions import (
    ConstraintFunctions,
    ConstraintPlace,
    constraint_functions,
    kind_of,
)
from olne_bench.games.compiled.stage_patterns import Entries, Pattern, half, merged, nonzeros
from olne_bench.games.compiled.terms import Term, TermFunctions, term_functions, terms_of
from olne_bench.games.model.constraints import Constraint
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import (
    Structure,
    numbers_of,
    structure_and_numbers,
    view_and_numbers,
    with_symbols,
)
from olne_bench.games.model.observation import View, observation_size


@dataclass(frozen=True, eq=False)
class LossFunctions:
    """Squared error of the samples of one player.

    Functions take (x (n,), y (d,), precision (d,), numbers of the view (P,)).

    Attributes:
        value: sum (precision (y - h(x)))^2 and its gradient (n,), in one column.
        hessian: nonzeros of the upper triangle, the diagonal halved, of its Hessian.
        pattern: where these sit.
    """

    value: ca.Function
    hessian: ca.Function
    pattern: Pattern

    @property
    def num_numbers(self) -> int:
        """P, of the view."""
        return self.value.numel_in(3)


@dataclass(frozen=True, eq=False)
class TermPlace:
    """Where one term belongs in the whole game.

    Attributes:
        kind: index of its functions.
        owner: its player.
        players: those whose states it looks at.
        indices: for each function but the costs, the place of each of its nonzeros among the
            values of the whole stage.
    """

    kind: int
    owner: int
    players: tuple[int, ...]
    indices: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class StageFunctions:
    """Everything about games of one structure, and one observation model, for an elimination.

    Attributes:
        num_players: N. num_states: N*n. num_weights: N*K. num_samples: N*d.
        num_controls: N*m, plus C where multipliers of constraints are unknowns of a stage.
        kinds: the functions of the terms.
        terms: all terms; their sum is the stage.
        loss: the observation model.
        blocks: patterns of Q, P, X, S, R, U, A, B.
        final_blocks: the same of the last stage; all but Q and X are empty.
        curvature: upper triangle, its diagonal halved, of the Hessian of l_t in the order
            (x, u, lambda, theta): the Hessian is this plus its transpose.
        final_curvature: the same for the last stage, in the same order.
        loss_indices: of each player, where the nonzeros of ``loss.hessian`` belong in the curvature
            and in that of the last stage.
        constraint_kinds: the functions of the constraints: of every step but the last, of the last.
        constraints: all constraints, whose margins come one after another.
        complementarity_kinds: the functions of constraints whose multipliers are unknowns.
        complementarities: these constraints, whose multipliers come one after another.
    """

    num_players: int
    num_states: int
    num_controls: int
    num_weights: int
    num_samples: int
    kinds: tuple[TermFunctions, ...]
    terms: tuple[TermPlace, ...]
    loss: LossFunctions
    blocks: tuple[Pattern, ...]
    final_blocks: tuple[Pattern, ...]
    curvature: Pattern
    final_curvature: Pattern
    loss_indices: tuple[tuple[np.ndarray, np.ndarray], ...]
    constraint_kinds: tuple[tuple[ConstraintFunctions, ConstraintFunctions], ...]
    constraints: tuple[ConstraintPlace, ...]
    complementarity_kinds: tuple[ComplementarityFunctions, ...] = ()
    complementarities: tuple[ComplementarityPlace, ...] = ()

    @property
    def num_multipliers(self) -> int:
        """C, number of multipliers among the unknowns of one stage."""
        kinds = self.complementarity_kinds
        return sum(kinds[place.kind].num_margins for place in self.complementarities)

    @property
    def own_controls(self) -> int:
        """m, of one player."""
        return (self.num_controls - self.num_multipliers) // self.num_players

    @property
    def num_margins(self) -> int:
        """C, number of margins of all constraints in one step."""
        kinds = self.constraint_kinds
        return sum(kinds[place.kind][0].num_margins for place in self.constraints)

    @property
    def size(self) -> int:
        """Length of z_t = (x_t, u_t, lambda_t), and of the rows (rx_t, ru_t, rf_t)."""
        return 2 * self.num_states + self.num_controls


def stage_functions(game: Game, view: View, *, condensed: bool = False) -> StageFunctions:
    """Derive (or fetch) the stage functions of a game's structure and an observation model.

    Args:
        game: the game.
        view: the observation model.
        condensed: whether constraints are condensed, as the interior point method needs them
            (``games.compiled.constraint_functions``), or else equations
            (``games.compiled.complementarity``).
    """
    structure, _ = structure_and_numbers(game)
    own_view = view_and_numbers(view, structure.dynamics)[0]
    return _stage_functions(structure, own_view, condensed)


@lru_cache(maxsize=64)
def _stage_functions(structure: Structure, view: View, condensed: bool) -> StageFunctions:
    terms = terms_of(structure)
    kinds = tuple(dict.fromkeys(term.kind for term in terms))
    functions = tuple(term_functions(kind) for kind in kinds)
    loss = _loss_functions(view, structure.dynamics)
    nothing: tuple[Constraint, ...] = ()
    split = (structure.constraints, nothing) if condensed else (nothing, structure.constraints)
    equation_kinds, equations = _equations(split[1], structure.dynamics)
    layout = _Layout(len(structure.players), structure, sum(equations.sizes))
    constraint_kinds, kind_places, nonzeros_of = _constraints(split[0], structure, layout)
    sizes = [constraint_kinds[k][0].num_margins for k in kind_places]
    stage = _merged_stage(
        [layout.entries(term, functions[kinds.index(term.kind)]) for term in terms],
        [
            layout.equation_entries(constraint, equation_kinds[kind], offset)
            for constraint, kind, offset in zip(
                split[1], equations.kinds, equations.offsets, strict=True
            )
        ],
        nonzeros_of,
        layout.loss_entries(loss),
    )
    return StageFunctions(
        num_players=layout.players,
        num_states=layout.players * layout.n,
        num_controls=layout.players * layout.m + layout.multipliers,
        num_weights=layout.players * layout.weights,
        num_samples=layout.players * observation_size(view, structure.dynamics),
        kinds=functions,
        terms=tuple(
            TermPlace(kinds.index(term.kind), term.owner, term.players, indices)
            for term, indices in zip(terms, stage.terms, strict=True)
        ),
        loss=loss,
        blocks=stage.blocks,
        final_blocks=stage.final_blocks,
        curvature=stage.curvature,
        final_curvature=stage.final_curvature,
        loss_indices=stage.losses,
        constraint_kinds=constraint_kinds,
        constraints=_constraint_places(split[0], sizes, kind_places, *stage.condensed),
        complementarity_kinds=equation_kinds,
        complementarities=() if condensed else equations.places(structure, stage.equations),
    )


@dataclass(frozen=True)
class _MergedStage:
    """Patterns of the whole stage, and where in them the nonzeros of all parts are."""

    blocks: tuple[Pattern, ...]
    final_blocks: tuple[Pattern, ...]
    curvature: Pattern
    final_curvature: Pattern
    terms: list[dict[str, np.ndarray]]
    equations: list[dict[str, np.ndarray]]
    condensed: tuple[list[np.ndarray], list[np.ndarray]]
    losses: tuple[tuple[np.ndarray, np.ndarray], ...]


def _merged_stage(
    terms: list[dict[str, Entries]],
    equations: list[dict[str, Entries]],
    condensed: list[list[Entries]],
    losses: list[Entries],
) -> _MergedStage:
    count, both = len(terms), terms + equations
    blocks, in_stage = merged([p["jacobian"] for p in both] + [c[0] for c in condensed])
    final_blocks, at_end = merged([p["final_jacobian"] for p in terms] + [c[1] for c in condensed])
    (curvature,), in_all = merged([part["hessian"] for part in both] + losses)
    (final_curvature,), in_last = merged([part["final_hessian"] for part in terms] + losses)
    found = [
        {
            "value": part["value"][0][1],
            "final_value": part["final_value"][0][1] if k < count else np.zeros(0, int),
            "jacobian": in_stage[k],
            "final_jacobian": at_end[k] if k < count else np.zeros(0, int),
            "hessian": in_all[k],
            "final_hessian": in_last[k] if k < count else np.zeros(0, int),
        }
        for k, part in enumerate(both)
    ]
    return _MergedStage(
        blocks=blocks,
        final_blocks=final_blocks,
        curvature=curvature,
        final_curvature=final_curvature,
        terms=found[:count],
        equations=found[count:],
        condensed=(in_stage[len(both) :], at_end[count:]),
        losses=tuple(zip(in_all[len(both) :], in_last[count:], strict=True)),
    )


@dataclass(frozen=True)
class _Equations:
    """Of each constraint that is an equation: its kind, and the place of its first multiplier."""

    kinds: list[int]
    sizes: list[int]

    @property
    def offsets(self) -> list[int]:
        return [sum(self.sizes[:k]) for k in range(len(self.sizes))]

    def places(
        self, structure: Structure, indices: list[dict[str, np.ndarray]]
    ) -> tuple[ComplementarityPlace, ...]:
        return tuple(
            ComplementarityPlace(
                kind, one.players, one.first_step, offset, structure.theta_places(one), found
            )
            for one, kind, offset, found in zip(
                structure.constraints, self.kinds, self.offsets, indices, strict=True
            )
        )


def _kinds(constraints: tuple[Constraint, ...]) -> tuple[list[Constraint], list[int]]:
    """The kinds of constraints, and the place of each one's kind among them."""
    kinds = list(dict.fromkeys(map(kind_of, constraints)))
    return kinds, [kinds.index(kind_of(constraint)) for constraint in constraints]


def _equations(
    constraints: tuple[Constraint, ...], dynamics: Dynamics
) -> tuple[tuple[ComplementarityFunctions, ...], _Equations]:
    """The functions of all kinds of constraints, and the kind of each."""
    kinds, places = _kinds(constraints)
    functions = tuple(complementarity_functions(kind, dynamics) for kind in kinds)
    return functions, _Equations(places, [functions[place].num_margins for place in places])


def _constraints(
    constraints: tuple[Constraint, ...], structure: Structure, layout: "_Layout"
) -> tuple[
    tuple[tuple[ConstraintFunctions, ConstraintFunctions], ...], list[int], list[list[Entries]]
]:
    """The functions of all kinds; of each constraint, its kind's number and nonzeros."""
    kinds, places = _kinds(constraints)
    pairs = tuple(constraint_functions(kind, structure.dynamics) for kind in kinds)
    nonzeros = [
        [layout.constraint_entries(constraint, functions) for functions in pairs[place]]
        for constraint, place in zip(constraints, places, strict=True)
    ]
    return pairs, places, nonzeros


def _constraint_places(
    constraints: tuple[Constraint, ...],
    sizes: list[int],
    kinds: list[int],
    in_stage: list[np.ndarray],
    at_end: list[np.ndarray],
) -> tuple[ConstraintPlace, ...]:
    return tuple(
        ConstraintPlace(kinds[k], c.players, c.first_step, sum(sizes[:k]), (in_stage[k], at_end[k]))
        for k, c in enumerate(constraints)
    )


@lru_cache(maxsize=64)
def _loss_functions(view: View, dynamics: Dynamics) -> LossFunctions:
    """Squared error of the samples, each times its precision (eqn. inverse_approach)."""
    state = ca.SX.sym("x", dynamics.state_size)
    sample = ca.SX.sym("y", observation_size(view, dynamics))
    precision = ca.SX.sym("precision", sample.numel())
    numbers = ca.SX.sym("numbers", len(numbers_of(view)))
    expected = with_symbols(view, numbers).expected(state, dynamics)
    loss = ca.sumsqr(precision * (sample - expected))
    pattern, values = nonzeros("H", half(ca.hessian(loss, state)[0]))
    arguments = [state, sample, precision, numbers]
    column = ca.densify(ca.vertcat(loss, ca.gradient(loss, state)))
    return LossFunctions(
        value=ca.Function("loss", arguments, [column]),
        hessian=ca.Function("loss_hessian", arguments, [ca.densify(values)]),
        pattern=pattern,
    )


class _Layout:
    """Where the rows and columns of one player's terms are in those of the whole game."""

    def __init__(self, players: int, structure: Structure, multipliers: int) -> None:
        self.players, self.multipliers = players, multipliers
        self.n, self.m = structure.dynamics.state_size, structure.dynamics.control_size
        self.weights = structure.num_theta
        self._theta_places = structure.theta_places
        self._in_x, self._in_u = players * self.n, players * self.m + multipliers

    def entries(self, term: Term, functions: TermFunctions) -> dict[str, Entries]:
        """The nonzeros of all functions of a term but the costs."""
        states, own = _spread(term.players, self.n), _spread((term.owner,), self.n)
        control, weights = (_spread((term.owner,), size) for size in (self.m, self.weights))
        in_x, in_u = self._in_x, self._in_u
        rows = np.concatenate([own, in_x + control, in_x + in_u + own])
        order = np.concatenate([states, in_x + control, in_x + in_u + own])
        order = np.concatenate([order, 2 * in_x + in_u + weights])
        sides = _sides(own, control, states, control, weights)
        sides |= {"A": (own, states), "B": (own, control), "G": (rows, _ONE), "H": (order, order)}
        return _placed(functions.patterns, sides)

    def constraint_entries(self, constraint: Constraint, functions: ConstraintFunctions) -> Entries:
        """The nonzeros that a constraint adds to the stage blocks."""
        states = _spread(constraint.players, self.n)
        control = _spread(constraint.players[:1], self.m)
        sides = _sides(states, control, states, control, _ONE)
        return _placed({"condensed": functions.blocks}, sides)["condensed"]

    def equation_entries(
        self, constraint: Constraint, functions: ComplementarityFunctions, offset: int
    ) -> dict[str, Entries]:
        """The nonzeros of all functions of a constraint that is an equation."""
        states, controls = (_spread(constraint.players, size) for size in (self.n, self.m))
        first, theta = self.players * self.m + offset, self._theta_places(constraint)
        inputs = np.concatenate([controls, np.arange(first, first + functions.num_margins)])
        rows = np.concatenate([states, self._in_x + inputs])
        order = np.concatenate([rows, 2 * self._in_x + self._in_u + theta])
        sides = _sides(states, inputs, states, inputs, theta)
        return _placed(functions.patterns, sides | {"G": (rows, _ONE), "H": (order, order)})

    def loss_entries(self, loss: LossFunctions) -> list[Entries]:
        """The nonzeros of the Hessian of each player's loss."""
        return [
            [("H", i * self.n + loss.pattern.rows, i * self.n + loss.pattern.columns)]
            for i in range(self.players)
        ]


#: Rows and columns, by the names of blocks.
_Sides = dict[str, tuple[np.ndarray, np.ndarray]]

_ONE = np.zeros(1, dtype=int)


def _spread(players: Sequence[int], size: int) -> np.ndarray:
    """The places of so many components of each of some players."""
    return np.concatenate([np.arange(j * size, (j + 1) * size) for j in players])


def _sides(
    by_x: np.ndarray, by_u: np.ndarray, x: np.ndarray, u: np.ndarray, theta: np.ndarray
) -> _Sides:
    """Rows, and columns, of the blocks of first derivatives."""
    return {
        **{"Q": (by_x, x), "P": (by_x, u), "X": (by_x, theta)},
        **{"S": (by_u, x), "R": (by_u, u), "U": (by_u, theta)},
    }


def _placed(patterns: dict[str, tuple[Pattern, ...]], sides: _Sides) -> dict[str, Entries]:
    """The nonzeros of functions in rows and columns of the game; of Hessians, the upper half."""
    found = {}
    for name, blocks in patterns.items():
        found[name] = [
            (block.name, sides[block.name][0][block.rows], sides[block.name][1][block.columns])
            for block in blocks
        ]
        if name.endswith("hessian"):
            found[name] = [(h, np.minimum(a, b), np.maximum(a, b)) for h, a, b in found[name]]
    return found

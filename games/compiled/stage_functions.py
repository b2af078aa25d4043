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

    l_t = loss(x_t; y_t) + p' g_x + q' g_u - r' f           (p, q, r: multipliers of rx, ru, rf),

all but the loss, which ``games.compiled.loss`` adds.

The blocks of one stage, all of them taken at (x_t, u_t, lambda_t, theta):

    Q = d g_x/dx   P = d g_x/du   X = d g_x/dtheta   A = df/dx
    S = d g_u/dx   R = d g_u/du   U = d g_u/dtheta   B = df/du     (dg_x/dlambda = -A', ...)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate

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
from olne_bench.games.compiled.derived import derived
from olne_bench.games.compiled.stage_patterns import Entries, Pattern, merged
from olne_bench.games.compiled.terms import FUNCTIONS, Term, TermFunctions, term_functions, terms_of
from olne_bench.games.model.constraints import Constraint
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Game
from olne_bench.games.model.numbers import Structure, structure_and_numbers


@dataclass(frozen=True, eq=False)
class TermPlace:
    """Where one term belongs in the whole game."""

    kind: int  # index of its functions
    owner: int  # its player
    players: tuple[int, ...]  # those whose states it looks at
    #: For each function but the costs, the place of each of its nonzeros among the values of the
    #: whole stage.
    indices: dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class StageFunctions:
    """Everything about games of one structure for an elimination."""

    origin: tuple[Structure, bool]  # what they are derived from; condensed constraints?
    num_players: int  # N
    num_states: int  # N*n
    num_controls: int  # N*m, plus C where multipliers of constraints are unknowns of a stage
    num_weights: int  # N*K
    kinds: tuple[TermFunctions, ...]  # the functions of the terms
    terms: tuple[TermPlace, ...]  # all terms; their sum is the stage
    blocks: tuple[Pattern, ...]  # patterns of Q, P, X, S, R, U, A, B
    final_blocks: tuple[Pattern, ...]  # the same of the last stage; all but Q and X are empty
    #: Upper triangle, its diagonal halved, of the Hessian of l_t in the order (x, u, lambda,
    #: theta): the Hessian is this plus its transpose.
    curvature: Pattern
    final_curvature: Pattern  # the same for the last stage, in the same order
    #: Of each player, where the upper triangle of its own states, row by row, is in the curvature
    #: and in that of the last stage: the loss of its samples belongs there.
    own_states: tuple[tuple[np.ndarray, np.ndarray], ...]
    #: The functions of the constraints: of every step but the last, of the last.
    constraint_kinds: tuple[tuple[ConstraintFunctions, ConstraintFunctions], ...]
    #: All constraints, whose margins come one after another.
    constraints: tuple[ConstraintPlace, ...]
    #: The functions of constraints whose multipliers are unknowns.
    complementarity_kinds: tuple[ComplementarityFunctions, ...] = ()
    #: These constraints, whose multipliers come one after another.
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


def stage_functions(game: Game, *, condensed: bool = False) -> StageFunctions:
    """Derive (or fetch) the stage functions of a game; constraints are condensed, or equations."""
    return _stage_functions(structure_and_numbers(game)[0], condensed)


@lru_cache(maxsize=64)
def _stage_functions(structure: Structure, condensed: bool) -> StageFunctions:
    origin = structure, condensed
    return derived("stages", origin, lambda: _derive(*origin))


def _derive(structure: Structure, condensed: bool) -> StageFunctions:
    dynamics, constraints = structure.dynamics, structure.constraints
    terms = terms_of(structure)
    term_kinds = list(dict.fromkeys(term.kind for term in terms))
    kinds = tuple(term_functions(kind) for kind in term_kinds)
    pairs, equations, placed = _kinds_and_places(constraints, dynamics, condensed)
    multipliers = sum(equations[kind].num_margins for _, kind, _ in placed if not condensed)
    layout = _Layout(len(structure.players), structure, multipliers)
    parts = [layout.entries(term, kinds[term_kinds.index(term.kind)]) for term in terms]
    if condensed:
        parts += [layout.constraint_entries(one, pairs[kind]) for one, kind, _ in placed]
    else:
        parts += [layout.equation_entries(one, equations[k], offset) for one, k, offset in placed]
    patterns, indices = _merged_parts(parts + layout.own_states())
    of_constraints = list(zip(placed, indices[len(terms) :], strict=False))
    return StageFunctions(
        origin=(structure, condensed),
        num_players=layout.players,
        num_states=layout.players * layout.n,
        num_controls=layout.players * layout.m + layout.multipliers,
        num_weights=layout.players * layout.weights,
        kinds=kinds,
        terms=tuple(
            TermPlace(term_kinds.index(term.kind), term.owner, term.players, found)
            for term, found in zip(terms, indices, strict=False)
        ),
        blocks=patterns["jacobian"],
        final_blocks=patterns["final_jacobian"],
        curvature=patterns["hessian"][0],
        final_curvature=patterns["final_hessian"][0],
        own_states=tuple(
            (found["hessian"], found["final_hessian"]) for found in indices[len(parts) :]
        ),
        constraint_kinds=pairs,
        constraints=tuple(
            ConstraintPlace(kind, one.players, one.first_step, offset, found)
            for (one, kind, offset), found in of_constraints
            if condensed
        ),
        complementarity_kinds=equations,
        complementarities=tuple(
            ComplementarityPlace(
                kind, one.players, one.first_step, offset, structure.theta_places(one), found
            )
            for (one, kind, offset), found in of_constraints
            if not condensed
        ),
    )


def _kinds_and_places(
    constraints: tuple[Constraint, ...], dynamics: Dynamics, condensed: bool
) -> tuple[
    tuple[tuple[ConstraintFunctions, ConstraintFunctions], ...],
    tuple[ComplementarityFunctions, ...],
    list[tuple[Constraint, int, int]],
]:
    """Functions of all kinds of constraints; each constraint with its kind and first margin."""
    shared = list(dict.fromkeys(map(kind_of, constraints)))
    kinds = [shared.index(kind_of(constraint)) for constraint in constraints]
    pairs = tuple(constraint_functions(kind, dynamics) for kind in shared if condensed)
    equations = tuple(complementarity_functions(kind, dynamics) for kind in shared if not condensed)
    counts = [one.num_margins for one in ([pair[0] for pair in pairs] if condensed else equations)]
    offsets = accumulate((counts[kind] for kind in kinds), initial=0)
    return pairs, equations, list(zip(constraints, kinds, offsets, strict=False))


def _merged_parts(
    parts: list[dict[str, Entries]],
) -> tuple[dict[str, tuple[Pattern, ...]], list[dict[str, np.ndarray]]]:
    """Patterns of the whole stage, by function, and where in them the nonzeros of each part are."""
    patterns: dict[str, tuple[Pattern, ...]] = {}
    indices: list[dict[str, np.ndarray]] = [{} for _ in parts]
    for name in FUNCTIONS[:6]:
        having = [k for k, part in enumerate(parts) if name in part]
        if name.endswith("value"):
            found = [parts[k][name][0][1] for k in having]
        else:
            patterns[name], found = merged([parts[k][name] for k in having])
        for k, places in zip(having, found, strict=True):
            indices[k][name] = places
    return patterns, indices


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

    def constraint_entries(
        self, constraint: Constraint, pair: tuple[ConstraintFunctions, ConstraintFunctions]
    ) -> dict[str, Entries]:
        """The nonzeros that a condensed constraint adds to the stage blocks, also at the end."""
        states = _spread(constraint.players, self.n)
        control = _spread(constraint.players[:1], self.m)
        sides = _sides(states, control, states, control, _ONE)
        return _placed({"jacobian": pair[0].blocks, "final_jacobian": pair[1].blocks}, sides)

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

    def own_states(self) -> list[dict[str, Entries]]:
        """The upper triangle of each player's states, the same at the end."""
        rows, columns = np.triu_indices(self.n)
        places: list[Entries] = [
            [("H", i * self.n + rows, i * self.n + columns)] for i in range(self.players)
        ]
        return [{"hessian": own, "final_hessian": own} for own in places]


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

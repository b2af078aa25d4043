"""The cost of one player at one stage as a sum of terms, each a function of few players.

A feature that looks at its own player only belongs to that player's term. One that is a sum over
others belongs to a term for each pair, and all pairs share the functions of one; one that names the
players that it looks at, to a term of these. Any other feature makes a term of everybody. So what
is derived and compiled does not grow with the players.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled.stage_patterns import Pattern, half, named_functions, nonzeros, stack
from olne_bench.games.model.costs import Feature, Stage, Watching
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Player
from olne_bench.games.model.numbers import Structure, numbers_of, with_symbols
from olne_bench.games.model.unknowns import at_means, unknowns_of, with_unknowns

#: Functions of a term, in the order of ``stages.c``.
FUNCTIONS = (
    *("value", "final_value", "jacobian", "final_jacobian", "hessian", "final_hessian"),
    *("cost", "final_cost", "motion"),
)

#: Points at which a feature is compared with a sum over pairs.
_TRIES = 20


@dataclass(frozen=True)
class TermKind:
    """What terms have in common that share their functions."""

    player: Player  # whose cost it is; features that are no part of the term cost nothing
    included: tuple[bool, ...]  # for each of the player's features, whether it is part of the term
    count: int  # number of players that the term looks at
    owner: int  # place of the player among them
    is_pair: bool  # whether what the player costs on its own is left out
    dynamics: Dynamics  # the motion model

    @property
    def is_own(self) -> bool:
        """Whether this is the term of one player, to which its motion belongs."""
        return self.count == 1

    @property
    def num_theta(self) -> int:
        """K + U of the owner: its weights and unknowns."""
        return len(self.player.preferences) + len(unknowns_of(self.player))

    def cost(
        self, states: Sequence[ca.SX], control: ca.SX | None, weights: ca.SX, numbers: ca.SX
    ) -> ca.SX:
        """The cost of one stage; of the last state where there is no control.

        States (n,) of each player, control (m,), weights (K + U,) and numbers (P,), dt first, of
        the owner.
        """
        count = len(self.player.preferences)
        names = [unknown.name for unknown in unknowns_of(self.player)]
        parameters = {name: weights[count + k] for k, name in enumerate(names)}
        player = with_unknowns(
            with_symbols(self.player, numbers[1:]),
            lambda unknown: unknown.value(parameters[unknown.name]),
        )
        stage = Stage(self.owner, tuple(states), control, self.dynamics, numbers[0])
        alone = Stage(0, (states[self.owner],), control, self.dynamics, numbers[0])
        values = []
        for feature, included in zip(player.features, self.included, strict=True):
            value = _value(feature, stage) if included else 0.0
            if included and self.is_pair:
                value -= _value(feature, alone)
            values.append(value)
        return ca.SX(player.weigh(weights[:count], values))


@dataclass(frozen=True, eq=False)
class TermFunctions:
    """What terms of one kind are worth, and their derivatives.

    Functions take (states of the players it looks at (count*n,), control (m,), costates (n,),
    weights (K,), numbers (P,), multipliers p (n,), q (m,), r (n,)). All but the states are those of
    the term's own player. Functions return one column of nonzeros.
    """

    kind: TermKind  # which terms these are
    functions: dict[str, ca.Function]  # by the names of ``FUNCTIONS``
    #: For every function but the costs, the blocks of its nonzeros, in rows and columns of the
    #: term: rows (g_x, g_u, f), columns (states, control, costates, weights).
    patterns: dict[str, tuple[Pattern, ...]]

    @property
    def num_numbers(self) -> int:
        """P, of the player."""
        return self.functions["value"].numel_in(4)

    def own_places(self, name: str) -> np.ndarray:
        """Where nonzeros belong in the rows (g_x, g_u, f), columns (x, u) of the own player.

        Of ``value`` and ``final_value`` these are rows, of ``jacobian`` and ``final_jacobian``
        places in a dense matrix, row by row; -1 for derivatives in other players' states and in
        weights.
        """
        n, m = self.kind.dynamics.state_size, self.kind.dynamics.control_size
        first_rows = {"Q": 0, "P": 0, "S": n, "R": n, "A": n + m, "B": n + m}
        found = []
        for block in self.patterns[name]:
            if block.name == "G":
                found.append(block.rows)
            elif block.name in "QSA":
                columns = block.columns - self.kind.owner * n
                places = (first_rows[block.name] + block.rows) * (n + m) + columns
                found.append(np.where((columns >= 0) & (columns < n), places, -1))
            elif block.name in "PRB":
                rows = first_rows[block.name] + block.rows
                found.append(rows * (n + m) + n + block.columns)
            else:
                found.append(np.full(block.size, -1))
        return np.concatenate(found)


@dataclass(frozen=True)
class Term:
    """One term of a game."""

    kind: TermKind  # its functions
    owner: int  # the player whose cost it is
    players: tuple[int, ...]  # those that it looks at, ``kind.count`` of them


@lru_cache(maxsize=64)
def term_functions(kind: TermKind) -> TermFunctions:
    """The functions of all terms of a kind."""
    n, m = kind.dynamics.state_size, kind.dynamics.control_size
    states, control = ca.SX.sym("x", kind.count * n), ca.SX.sym("u", m)
    costates, weights = ca.SX.sym("lambda", n), ca.SX.sym("theta", kind.num_theta)
    numbers = ca.SX.sym("numbers", 1 + len(numbers_of(kind.player)))
    p, q, r = ca.SX.sym("p", n), ca.SX.sym("q", m), ca.SX.sym("r", n)
    each = ca.vertsplit(states, n)
    own = slice(kind.owner * n, (kind.owner + 1) * n)

    cost = kind.cost(each, control, weights, numbers)
    last_cost = kind.cost(each, None, weights, numbers)
    moved = kind.dynamics.step(states, control, numbers[0]) if kind.is_own else ca.SX(0, 1)
    lagrangian = ca.cse(cost - ca.dot(costates, moved) if kind.is_own else cost)
    g_x, g_u = ca.gradient(lagrangian, states)[own], ca.gradient(lagrangian, control)
    g_last = ca.gradient(last_cost, states)[own]

    motion = ca.vertcat(states, control)
    total = _slope(kind, lagrangian, motion, p, q) - (ca.dot(r, moved) if kind.is_own else 0)
    order = ca.vertcat(states, control, costates, weights)
    blocks = {
        "value": nonzeros("G", ca.vertcat(g_x, g_u, moved)),
        "final_value": nonzeros("G", g_last),
        "hessian": nonzeros("H", half(ca.hessian(ca.cse(total), order)[0])),
        "final_hessian": nonzeros("H", half(ca.hessian(ca.dot(p, g_last), order)[0])),
    }
    stacked = {
        "jacobian": stack(
            Q=ca.jacobian(g_x, states),
            P=ca.jacobian(g_x, control),
            X=ca.jacobian(g_x, weights),
            S=ca.jacobian(g_u, states),
            R=ca.jacobian(g_u, control),
            U=ca.jacobian(g_u, weights),
            A=ca.jacobian(moved, states),
            B=ca.jacobian(moved, control),
        ),
        "final_jacobian": stack(Q=ca.jacobian(g_last, states), X=ca.jacobian(g_last, weights)),
    }
    values = {name: values for name, (_, values) in (blocks | stacked).items()}
    values |= {"cost": cost, "final_cost": last_cost, "motion": moved}
    arguments = [states, control, costates, weights, numbers, p, q, r]
    return TermFunctions(
        kind=kind,
        functions=named_functions(FUNCTIONS, arguments, values),
        patterns={name: (pattern,) for name, (pattern, _) in blocks.items()}
        | {name: patterns for name, (patterns, _) in stacked.items()},
    )


def _slope(kind: TermKind, lagrangian: ca.SX, motion: ca.SX, p: ca.SX, q: ca.SX) -> ca.SX:
    """p'g_x + q'g_u, as the slope of the Lagrangian along (p, q): half the code of the sum."""
    n = kind.dynamics.state_size
    along = [p if k == kind.owner else ca.SX.zeros(n) for k in range(kind.count)]
    return ca.jtimes(lagrangian, motion, ca.vertcat(*along, q))


def terms_of(structure: Structure) -> list[Term]:
    """All terms of a game's costs, the players' own ones first."""
    own, coupled = [], []
    count, dynamics = len(structure.players), structure.dynamics
    for i, player in enumerate(structure.players):
        reaches = [reach(feature, i, count, dynamics) for feature in player.features]
        named = [f.watched if isinstance(f, Watching) else () for f in player.features]
        player = player.changed(_in_order)
        alone = tuple(r not in ("all", "named") for r in reaches)
        kind = TermKind(player.changed(_on_its_own), alone, 1, 0, False, dynamics)
        own.append(Term(kind, i, (i,)))
        if "pair" in reaches:
            included = tuple(r == "pair" for r in reaches)
            kind = replace(kind, included=included, count=2, is_pair=True)
            coupled += [Term(kind, i, (i, j)) for j in range(count) if j != i]
        for watched in dict.fromkeys(filter(None, named)):
            included = tuple(own == watched for own in named)
            kind = TermKind(player, included, 1 + len(watched), 0, False, dynamics)
            coupled.append(Term(kind, i, (i, *watched)))
        if "all" in reaches:
            included = tuple(r == "all" for r in reaches)
            kind = TermKind(player, included, count, i, False, dynamics)
            coupled.append(Term(kind, i, tuple(range(count))))
    return own + coupled


def _on_its_own(feature: Feature) -> Feature:
    """The feature, without the players that it names, as its terms are others."""
    return feature.watching(()) if isinstance(feature, Watching) else feature


def _in_order(feature: Feature) -> Feature:
    """The feature, the players that it names being those after its own, so that functions fit."""
    if not isinstance(feature, Watching):
        return feature
    return feature.watching(tuple(range(1, 1 + len(feature.watched))))


def _value(feature: Feature, stage: Stage) -> ca.SX | float:
    if stage.control is None:
        return feature.final_cost(stage)
    return feature.running_cost(stage)


@lru_cache(maxsize=1024)
def reach(feature: Feature, player: int, count: int, dynamics: Dynamics) -> str:
    """Of which players the states decide what a feature costs a player.

    ``own``: of the player alone. ``pair``: a sum over others, each part depends on the two.
    ``named``: of those that it names. ``all``: none of these.
    """
    if isinstance(feature, Watching):
        return "named"
    states = [ca.SX.sym(f"x{j}", dynamics.state_size) for j in range(count)]
    control = ca.SX.sym("u", dynamics.control_size)
    numbers = ca.SX.sym("numbers", len(numbers_of(feature)))
    feature = at_means(with_symbols(feature, numbers))
    dt = ca.SX.sym("dt")

    def both(place: int, seen: Sequence[ca.SX]) -> ca.SX:
        stage = Stage(place, tuple(seen), control, dynamics, dt)
        last = replace(stage, control=None)
        return ca.vertcat(_value(feature, stage), _value(feature, last))

    whole = both(player, states)
    others = [state for j, state in enumerate(states) if j != player]
    own = states[player]
    needs_others = bool(others) and ca.depends_on(whole, ca.vertcat(*others))
    try:
        summed = alone = both(0, [own])
        if needs_others:
            summed += sum(both(0, [own, other]) - alone for other in others)
    except Exception:  # somebody's formula may need all players
        return "all"
    if not _equal(whole, summed, ca.vertcat(*states, control, numbers, dt)):
        return "all"
    return "pair" if needs_others else "own"


def _equal(one: ca.SX, other: ca.SX, arguments: ca.SX) -> bool:
    """Whether two expressions are equal at points of which some are close to each other."""
    both = ca.Function("both", [arguments], [one - other, one])
    spreads = np.logspace(-3, 1, _TRIES)
    drawn = np.random.default_rng(0).uniform(-0.5, 0.5, (_TRIES, arguments.numel()))
    missing, size = map(np.array, both((1 + spreads[:, None] * drawn).T))
    finite = np.isfinite(size).all(axis=0)
    most = 1e-9 * (1 + np.abs(size[:, finite]).max(axis=0, initial=0.0))
    return bool(finite.any() and (np.abs(missing[:, finite]).max(axis=0) < most).all())

"""The cost of one player at one stage as a sum of terms, each a function of few players.

A feature that looks at its own player only belongs to the term of that player. A feature that looks
at others is, as a rule, a sum over them. It belongs to one term for each pair of players, and all
pairs share the functions of one. A feature that is no such sum, or that asks which number a player
has, makes a term of everybody.

So the functions that are derived and compiled do not grow with the number of players.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.model.costs import Feature, Stage
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Player
from olne_bench.games.model.numbers import Structure, numbers_of, with_symbols
from olne_bench.games.model.unknowns import at_means, unknowns_of, with_unknowns

#: Points at which a feature is compared with a sum over pairs.
_TRIES = 20


@dataclass(frozen=True)
class TermKind:
    """What terms have in common that share their functions.

    Attributes:
        player: whose cost it is; features that are no part of the term cost nothing.
        included: for each of the player's features, whether it is part of the term.
        count: number of players that the term looks at.
        owner: place of the player among them.
        is_pair: whether what the player costs on its own is left out.
        dynamics: the motion model.
    """

    player: Player
    included: tuple[bool, ...]
    count: int
    owner: int
    is_pair: bool
    dynamics: Dynamics

    @property
    def is_own(self) -> bool:
        """Whether this is the term of one player, to which its motion belongs."""
        return self.count == 1

    @property
    def num_theta(self) -> int:
        """K + U of the owner: its weights and unknowns."""
        return len(self.player.preferences) + len(unknowns_of(self.player))

    def cost(
        self,
        states: Sequence[ca.SX],
        control: ca.SX | None,
        weights: ca.SX,
        numbers: ca.SX,
    ) -> ca.SX:
        """The cost of one stage; of the last state where there is no control.

        Args:
            states: one (n,) for each of the ``count`` players.
            control: (m,) of the owner, or None.
            weights: (K + U,) of the owner, its standardised parameters behind the weights.
            numbers: (P,) of the owner, dt first.
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


@dataclass(frozen=True)
class Term:
    """One term of a game.

    Attributes:
        kind: its functions.
        owner: the player whose cost it is.
        players: those that it looks at, ``kind.count`` of them.
    """

    kind: TermKind
    owner: int
    players: tuple[int, ...]


def terms_of(structure: Structure) -> list[Term]:
    """All terms of a game's costs, the players' own ones first."""
    own, coupled = [], []
    count, dynamics = len(structure.players), structure.dynamics
    for i, player in enumerate(structure.players):
        reaches = [reach(feature, i, count, dynamics) for feature in player.features]
        kind = TermKind(player, tuple(r != "all" for r in reaches), 1, 0, False, dynamics)
        own.append(Term(kind, i, (i,)))
        if "pair" in reaches:
            included = tuple(r == "pair" for r in reaches)
            kind = replace(kind, included=included, count=2, is_pair=True)
            coupled += [Term(kind, i, (i, j)) for j in range(count) if j != i]
        if "all" in reaches:
            included = tuple(r == "all" for r in reaches)
            kind = TermKind(player, included, count, i, False, dynamics)
            coupled.append(Term(kind, i, tuple(range(count))))
    return own + coupled


def _value(feature: Feature, stage: Stage) -> ca.SX | float:
    if stage.control is None:
        return feature.final_cost(stage)
    return feature.running_cost(stage)


@lru_cache(maxsize=1024)
def reach(feature: Feature, player: int, count: int, dynamics: Dynamics) -> str:
    """Of which players the states decide what a feature costs a player.

    ``own``: of the player alone. ``pair``: the cost is a sum over the other players, each part of
    which depends on the player and on that one. ``all``: neither.
    """
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
    try:
        alone = both(0, [own])
        summed = alone + sum(both(0, [own, other]) - alone for other in others)
    except Exception:  # somebody's formula may need all players
        return "all"
    arguments = ca.vertcat(*states, control, numbers, dt)
    if not (others and ca.depends_on(whole, ca.vertcat(*others))):
        return "own" if _equal(whole, alone, arguments) else "all"
    return "pair" if _equal(whole, summed, arguments) else "all"


def _equal(one: ca.SX, other: ca.SX, arguments: ca.SX) -> bool:
    """Whether two expressions are equal at points of which some are close to each other."""
    both = ca.Function("both", [arguments], [one - other, one])
    rng, compared = np.random.default_rng(0), 0
    for spread in np.logspace(-3, 1, _TRIES):
        point = 1 + spread * rng.uniform(-0.5, 0.5, arguments.numel())
        missing, size = map(np.array, both(point))
        if np.isfinite(size).all():
            compared += 1
            if not np.abs(missing).max() < 1e-9 * (1 + np.abs(size).max()):
                return False
    return compared > 0

"""Structure and numbers of a game apart, so that games of one structure share their solvers.

The structure says which features a player has and how they are written down. Functions that are
derived from it take the numbers (targets, lanes, scales, dt) as arguments. Every ``float`` in a
field of a frozen dataclass is a number, however deep, and so is every whole number in a field that
is not annotated as ``int``. All else, and everything in a feature that is no dataclass, is
structure.

A formula that decides by a number (``if self.target > 0``), or brings it to a ``float``, raises
with a symbol in its place, or means something else. Such a feature keeps its numbers in the
structure, and each value has a solver of its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from olne_bench.games.model.constraints import Constraint, constraint_unknowns
from olne_bench.games.model.costs import Feature, Resizable, Stage
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.game import Game, Player, listed_unknowns
from olne_bench.games.model.observation import Components, View
from olne_bench.games.model.unknowns import Unknown, at_means, unknowns_of

#: Points at which a formula with symbols is compared with the one of its numbers.
_TRIES = 3


@dataclass(frozen=True)
class Structure:
    """What games of one family have in common."""

    players: tuple[Player, ...]  # of the game, with zeros for their numbers
    dynamics: Dynamics  # the motion model
    constraints: tuple[Constraint, ...] = ()

    @property
    def num_theta(self) -> int:
        """K + U: the weights of a player, and the unknowns of the player that has most."""
        return len(self.players[0].preferences) + max(map(len, self._listed))

    def theta_places(self, constraint: Constraint) -> np.ndarray:
        """Where in theta (N*(K+U),) the unknowns of a constraint are, in their order."""
        listed = constraint_unknowns(self.constraints)
        first, places = len(self.players[0].preferences), []
        for unknown in unknowns_of(constraint):
            player = listed[unknown.name][1]
            names = [own.name for own in self._listed[player]]
            places.append(player * self.num_theta + first + names.index(unknown.name))
        return np.array(places, dtype=np.int32)

    @property
    def _listed(self) -> tuple[tuple[Unknown, ...], ...]:
        return listed_unknowns(self.players, self.constraints)

    @property
    def num_numbers(self) -> int:
        """P: dt and the numbers of the player that has most."""
        return 1 + max(len(numbers_of(player)) for player in self.players)


@dataclass(frozen=True)
class LiteralFeature:
    """A feature that cannot be written down with symbols: its numbers, and dt, stay literals."""

    feature: Feature
    dt: float

    @property
    def name(self) -> str:
        return self.feature.name

    def running_cost(self, stage: Stage) -> ca.SX | float:
        return self.feature.running_cost(replace(stage, dt=self.dt))

    def final_cost(self, stage: Stage) -> ca.SX | float:
        return self.feature.final_cost(replace(stage, dt=self.dt))


@dataclass(frozen=True)
class LiteralView(View):
    """A view that cannot be written down with symbols: its numbers stay where they are."""

    view: View

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.view.name

    def expected(self, state: ca.SX, dynamics: Components) -> ca.SX:
        return self.view.expected(state, dynamics)


@dataclass(frozen=True)
class LiteralStep:
    """The step of a motion model that decides by dt."""

    step: Callable[[ca.SX, ca.SX, ca.SX | float], ca.SX]
    dt: float

    def __call__(self, state: ca.SX, control: ca.SX, dt: ca.SX | float) -> ca.SX:
        return self.step(state, control, self.dt)


_LITERAL = (LiteralFeature, LiteralView, LiteralStep)


@lru_cache(maxsize=256)
def structure_and_numbers(game: Game) -> tuple[Structure, np.ndarray]:
    """A game's structure, and numbers (N, P), read-only: dt, each player's features, then zeros."""
    dt, dynamics = float(game.dt), game.dynamics
    if not _step_takes_symbols(dynamics, _Example(None, dt)):
        dynamics = replace(dynamics, step=LiteralStep(dynamics.step, dt))

    def checked(player: int, feature: Feature) -> Feature:
        takes = _feature_takes_symbols(
            skeleton(feature), player, game.num_players, game.dynamics, _Example(feature, dt)
        )
        if takes:
            return feature
        if unknowns := unknowns_of(feature):
            raise ValueError(
                f"feature {feature.name!r} decides by its numbers, so none of them can be unknown: "
                + ", ".join(unknown.name for unknown in unknowns)
            )
        return LiteralFeature(feature, dt)

    players = _changed(_of_one_size(game.players), checked)
    table = numbers_table(players, dt)
    table.setflags(write=False)
    constraints = tuple(map(skeleton, game.constraints))
    return Structure(tuple(map(skeleton, players)), dynamics, constraints), table


def numbers_table(things: Sequence[Player | Constraint], dt: float) -> np.ndarray:
    """The numbers (things, P) of players or constraints: dt and their own, zeros behind them."""
    rows = [(float(dt), *numbers_of(thing)) for thing in things]
    table = np.zeros((len(rows), max(map(len, rows), default=0)))
    for row, numbers in zip(table, rows, strict=True):
        row[: len(numbers)] = numbers
    return table


@lru_cache(maxsize=256)
def view_and_numbers(view: View, dynamics: Components) -> tuple[View, np.ndarray]:
    """The structure of a view, and its numbers (P,); none where the view decides by them."""
    if not _view_takes_symbols(skeleton(view), dynamics, _Example(view)):
        return LiteralView(view), np.zeros(0)
    return skeleton(view), np.array(numbers_of(view), dtype=float)


def numbers_of(thing: Any) -> tuple[float, ...]:
    """The numbers of a dataclass or a tuple of them, in the order of ``with_numbers``."""
    found: list[float] = []

    def note(number: float) -> float:
        found.append(float(number))
        return number

    with_numbers(thing, note)
    return tuple(found)


def with_symbols(thing: Any, symbols: ca.SX) -> Any:
    """A copy of a dataclass, or a tuple of them, whose numbers are a column's first symbols."""
    remaining = iter(ca.vertsplit(symbols))
    return with_numbers(thing, lambda _: next(remaining))


def with_numbers(thing: Any, change: Callable[[float], Any], annotation: object = None) -> Any:
    """A copy of a dataclass, tuple or field with every number changed, in the order of fields.

    No ``__post_init__`` runs: its checks compare numbers, and symbols cannot be compared. The
    annotation is that of the field.
    """
    if isinstance(thing, _LITERAL):
        return thing
    if isinstance(thing, tuple):
        parts = [with_numbers(part, change, annotation) for part in thing]
        return tuple(parts) if type(thing) is tuple else type(thing)(*parts)
    if is_dataclass(thing) and not isinstance(thing, type):
        copy = object.__new__(type(thing))
        for field in fields(thing):
            value = with_numbers(getattr(thing, field.name), change, field.type)
            object.__setattr__(copy, field.name, value)
        return copy
    return change(thing) if _is_number(thing, annotation) else thing


def _is_number(value: object, annotation: object) -> bool:
    if isinstance(value, (bool, np.bool_)):
        return False
    if isinstance(value, (int, np.integer)):
        return "int" not in str(annotation)
    return isinstance(value, (float, np.floating))


def skeleton(thing: Any) -> Any:
    """A copy with zeros for its numbers."""
    return with_numbers(thing, lambda _: 0.0)


@dataclass(frozen=True)
class _Example:
    """Numbers to try a formula at. All are equal, so that caches keep what one has shown."""

    thing: Any = field(compare=False)
    dt: float = field(default=1.0, compare=False)

    @property
    def values(self) -> tuple[float, ...]:
        """dt, then the numbers."""
        return (self.dt, *numbers_of(self.thing))


@lru_cache(maxsize=1024)
def _feature_takes_symbols(
    skeleton: Feature, player: int, count: int, dynamics: Dynamics, example: _Example
) -> bool:
    """Whether a feature can be written down with symbols for dt and its numbers."""
    states = tuple(ca.SX.sym(f"x{j}", dynamics.state_size) for j in range(count))
    control = ca.SX.sym("u", dynamics.control_size)

    def written(feature: Feature, dt: ca.SX | float) -> ca.SX:
        feature = at_means(feature)
        stage = Stage(player, states, control, dynamics, dt)
        last = replace(stage, control=None)
        return ca.vertcat(feature.running_cost(stage), feature.final_cost(last))

    return _equal_with_symbols(written, skeleton, example, ca.vertcat(*states, control))


@lru_cache(maxsize=256)
def _view_takes_symbols(skeleton: View, dynamics: Components, example: _Example) -> bool:
    """Whether a view can be written down with symbols for its numbers."""
    state = ca.SX.sym("x", dynamics.state_size)
    return _equal_with_symbols(
        lambda view, _: view.expected(state, dynamics), skeleton, example, state
    )


@lru_cache(maxsize=64)
def _step_takes_symbols(dynamics: Dynamics, example: _Example) -> bool:
    """Whether a motion model can be written down with a symbol for dt."""
    state, control = ca.SX.sym("x", dynamics.state_size), ca.SX.sym("u", dynamics.control_size)
    return _equal_with_symbols(
        lambda _, dt: dynamics.step(state, control, dt), None, example, ca.vertcat(state, control)
    )


def _equal_with_symbols(
    write: Callable[[Any, ca.SX | float], ca.SX | float],
    skeleton: Any,
    example: _Example,
    arguments: ca.SX,
) -> bool:
    """Whether a formula of (thing, dt), written down with symbols, has the example's values."""
    symbols = ca.SX.sym("numbers", len(example.values))
    literal = ca.SX(write(example.thing, example.dt))
    try:
        written = ca.SX(write(with_symbols(skeleton, symbols[1:]), symbols[0]))
    except Exception:  # whatever it is that somebody's formula does with a symbol
        return False
    if written.shape != literal.shape:
        return False
    both = ca.Function("both", [arguments, symbols], [ca.densify(literal), ca.densify(written)])
    rng = np.random.default_rng(0)
    points = rng.uniform(0.5, 1.5, (_TRIES, arguments.numel()))
    for point in points:
        one, other = map(np.array, both(point, example.values))
        if not np.allclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True):
            return False
    return True


def _changed(
    players: tuple[Player, ...], change: Callable[[int, Feature], Feature]
) -> tuple[Player, ...]:
    """The players with changed features, each by its player's number."""
    return tuple(
        replace(
            player,
            preferences=tuple(change(i, feature) for feature in player.preferences),
            task=tuple(change(i, feature) for feature in player.task),
        )
        for i, player in enumerate(players)
    )


def _of_one_size(players: tuple[Player, ...]) -> tuple[Player, ...]:
    """The players, features that come in sizes brought to the largest of their kind."""
    sizes: dict[type, int] = {}
    for player in players:
        for feature in player.features:
            if isinstance(feature, Resizable):
                kind = type(feature)
                sizes[kind] = max(sizes.get(kind, 0), feature.size)

    def resized(_: int, feature: Feature) -> Feature:
        if isinstance(feature, Resizable):
            return feature.resized(sizes[type(feature)])
        return feature

    return _changed(players, resized)

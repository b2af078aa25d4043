"""A dynamic game: players, their cost features, one motion model, a horizon.

Weight layout
-------------
``weights`` is an array (N, K): row i belongs to player i, column k to ``game.weight_names[k]``,
which is the order of every player's ``preferences``. Weights are non-negative and only their
ratios matter to behaviour, so the convention is that each row sums to one. A player's ``task``
terms (its goal, its lane) encode what it has to do rather than what it likes: they are scaled by
the *mean* of its weights, which keeps the cost homogeneous in the weights.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial

import casadi as ca
import numpy as np

from olne_bench.games.model.constraints import (
    Constraint,
    check_constraints,
    constraint_unknowns,
    described,
)
from olne_bench.games.model.costs import Feature, Stage, Watching
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.unknowns import Parameters, Unknown, unknowns_of, with_unknowns


@dataclass(frozen=True)
class Player:
    """The cost features of one player.

    Attributes:
        preferences: K weighted features; estimators estimate their weights.
        task: features scaled by the mean of the player's weights.
    """

    preferences: tuple[Feature, ...]
    task: tuple[Feature, ...] = ()

    def running_cost(self, stage: Stage, weights: ca.SX) -> ca.SX:
        """Cost of a step t < T for weights (K,)."""
        return self.weigh(weights, [feature.running_cost(stage) for feature in self.features])

    def final_cost(self, stage: Stage, weights: ca.SX) -> ca.SX:
        """Cost of the last state for weights (K,)."""
        return self.weigh(weights, [feature.final_cost(stage) for feature in self.features])

    @property
    def features(self) -> tuple[Feature, ...]:
        """Preferences, then the task."""
        return (*self.preferences, *self.task)

    def changed(self, change: Callable[[Feature], Feature]) -> "Player":
        """The player with each of its features changed."""
        return Player(tuple(map(change, self.preferences)), tuple(map(change, self.task)))

    def weigh(self, weights: ca.SX, values: list[ca.SX | float]) -> ca.SX:
        """The cost of values of all ``features``, in their order, for weights (K,)."""
        count = len(self.preferences)
        mean = ca.sum1(weights) / count
        own: ca.SX = ca.dot(weights, ca.vertcat(*values[:count]))
        return own + mean * sum(values[count:])


@dataclass(frozen=True)
class Game:
    """An open-loop dynamic game without weights and initial state, hence without ground truth.

    Raises ValueError if a parameter is out of range, the players' preferences differ in name, or
    constraints do not fit the game or contradict each other.

    Attributes:
        players: N players whose preferences carry the same names in the same order.
        dynamics: the motion model of every player.
        horizon: T, number of states of a trajectory, at least 2.
        dt: step [s], positive.
        constraints: what the players have to keep, shared (several players) and private (one).
    """

    players: tuple[Player, ...]
    dynamics: Dynamics
    horizon: int
    dt: float
    constraints: tuple[Constraint, ...] = ()

    def __post_init__(self) -> None:
        if not self.players:
            raise ValueError("a game needs at least one player, got none")
        if not isinstance(self.horizon, int) or self.horizon < 2:
            raise ValueError(f"horizon must be an integer of at least 2, got {self.horizon!r}")
        if not (isinstance(self.dt, (int, float)) and 0 < self.dt < float("inf")):
            raise ValueError(f"dt must be a positive number of seconds, got {self.dt!r}")
        if not self.weight_names:
            raise ValueError("a player needs at least one preference, got none")
        for index, player in enumerate(self.players):
            names = tuple(feature.name for feature in player.preferences)
            if names != self.weight_names:
                raise ValueError(
                    f"player {index} has the preferences {names}, "
                    f"player 0 has {self.weight_names}: all players need the same"
                )
        for index, player in enumerate(self.players):
            self._check_watched(index, player)
        if len(set(self.weight_names)) != len(self.weight_names):
            raise ValueError(f"preferences need different names, got {self.weight_names}")
        check_constraints(self.constraints, self.num_players, self.horizon, self.dynamics, self.dt)
        if self.constraints:
            listed_unknowns(self.players, self.constraints)

    def _check_watched(self, index: int, player: Player) -> None:
        for feature in player.features:
            for other in feature.watched if isinstance(feature, Watching) else ():
                if other == index or not 0 <= other < self.num_players:
                    raise ValueError(
                        f"feature {feature.name!r} of player {index} looks at player {other}: "
                        f"expected another one of the players 0 to {self.num_players - 1}"
                    )

    def __repr__(self) -> str:
        """One line: players, time, motion model, weights and what else is special."""
        parts = [
            f"{self.num_players} players, {self.horizon} states of {self.dt:g} s",
            self.dynamics.name,
            f"weights {', '.join(self.weight_names)}",
        ]
        if self.constraints:
            parts.append(f"{len(self.constraints)} constraints")
        if unknown := {one.name for own in self.parameters.unknowns for one in own}:
            parts.append(f"unknown {', '.join(sorted(unknown))}")
        return f"Game({'; '.join(parts)})"

    @cached_property
    def weight_names(self) -> tuple[str, ...]:
        """Names of the K weights of each player, in column order."""
        return tuple(feature.name for feature in self.players[0].preferences)

    @property
    def num_players(self) -> int:
        """Number of players, N."""
        return len(self.players)

    @property
    def num_weights(self) -> int:
        """Number of weights per player, K."""
        return len(self.weight_names)

    @cached_property
    def parameters(self) -> Parameters:
        """The unknowns of each player, besides its weights (``listed_unknowns``)."""
        return Parameters(listed_unknowns(self.players, self.constraints))

    def known(self, values: np.ndarray) -> "Game":
        """The game in which unknowns have the values (N, U), in units, as of ``parameters``.

        Raises ValueError on a wrong shape, or a number that is missing or out of its range.
        """
        values = self.parameters.check(values)
        players = []
        for player, found in zip(self.players, self._by_name(values), strict=True):
            players.append(with_unknowns(player, partial(_named, found)))
        return replace(self, players=tuple(players), constraints=self._known_constraints(values))

    def describe_unknown(self, player: int, index: int) -> str:
        """The name of an unknown and whose it is, for messages."""
        unknown = self.parameters.unknowns[player][index]
        for constraint in self.constraints:
            if unknown.name in map(_name, unknowns_of(constraint)):
                return f"the {unknown.name} of {described(constraint)}"
        return f"the {unknown.name} of player {player}"

    def with_known_constraints(self, theta: np.ndarray) -> tuple["Game", np.ndarray]:
        """The game in which constraints' unknowns are known from theta (N, K + U); its theta."""
        if not self._unknown_constraints:
            return self, theta
        known = copy(self._without_constraints)  # checks of a thousand games would take a second
        values = self.parameters.values(theta[:, self.num_weights :])
        object.__setattr__(known, "constraints", self._known_constraints(values))
        return known, theta[:, : self.num_weights + known.parameters.count]

    @cached_property
    def _without_constraints(self) -> "Game":
        game = replace(self, constraints=())
        assert game.parameters.count <= self.parameters.count
        return game

    def _by_name(self, values: np.ndarray) -> list[dict[str, float]]:
        """Values (N, U) of each player's unknowns."""
        return [
            {unknown.name: float(value) for unknown, value in zip(own, row, strict=False)}
            for own, row in zip(self.parameters.unknowns, values, strict=True)
        ]

    @cached_property
    def _unknown_constraints(self) -> dict[str, tuple[Unknown, int]]:
        return constraint_unknowns(self.constraints)

    def _known_constraints(self, values: np.ndarray) -> tuple[Constraint, ...]:
        by_player = self._by_name(values)
        listed = self._unknown_constraints.items()
        found = {name: by_player[player][name] for name, (_, player) in listed}
        known: tuple[Constraint, ...] = with_unknowns(self.constraints, partial(_named, found))
        return known

    @cached_property
    def at_means(self) -> "Game":
        """The game whose unknowns have the means of their priors; this one if there are none."""
        return self.known(self.parameters.means) if self.parameters.count else self

    @property
    def state_shape(self) -> tuple[int, int, int]:
        """Shape of states, (T, N, n)."""
        return (self.horizon, self.num_players, self.dynamics.state_size)

    @property
    def control_shape(self) -> tuple[int, int, int]:
        """Shape of controls, (T-1, N, m)."""
        return (self.horizon - 1, self.num_players, self.dynamics.control_size)

    def check_weights(self, weights: np.ndarray) -> np.ndarray:
        """Weights as float64 (N, K), each row scaled to sum one.

        Raises ValueError on a wrong shape, a negative or non-finite entry, or a row of zeros.
        """
        weights = np.asarray(weights, dtype=float)
        expected = (self.num_players, self.num_weights)
        if weights.shape != expected:
            raise ValueError(f"weights have the shape {weights.shape}, expected {expected}")
        if not np.isfinite(weights).all() or (weights < 0).any():
            raise ValueError(f"weights must be finite and non-negative, got {weights.tolist()}")
        totals = weights.sum(axis=1, keepdims=True)
        if (totals <= 0).any():
            raise ValueError(f"each player needs a positive weight, got {weights.tolist()}")
        return np.asarray(weights / totals)

    def check_theta(self, theta: np.ndarray) -> np.ndarray:
        """Theta as float64 (N, K + U); ValueError as ``check_weights``, or if not finite."""
        theta = np.asarray(theta, dtype=float)
        expected = (self.num_players, self.num_weights + self.parameters.count)
        if theta.shape != expected:
            raise ValueError(f"weights have the shape {theta.shape}, expected {expected}")
        weights, parameters = np.split(theta, [self.num_weights], axis=1)
        if not np.isfinite(parameters).all():
            raise ValueError(f"parameters must be finite, got {parameters.tolist()}")
        return np.hstack([self.check_weights(weights), parameters])

    def check_initial_state(self, initial_state: np.ndarray) -> np.ndarray:
        """Initial state as float64 (N, n); ValueError on a wrong shape or a non-finite entry."""
        initial_state = np.asarray(initial_state, dtype=float)
        expected = self.state_shape[1:]
        if initial_state.shape != expected:
            raise ValueError(
                f"initial_state has the shape {initial_state.shape}, expected {expected}"
            )
        if not np.isfinite(initial_state).all():
            raise ValueError(f"initial_state must be finite, got {initial_state.tolist()}")
        return initial_state


def listed_unknowns(
    players: Sequence[Player], constraints: Sequence[Constraint]
) -> tuple[tuple[Unknown, ...], ...]:
    """The unknowns of each player: those of its features, then those of constraints.

    A constraint's number is nobody's own. It is listed once, with the first player of the first
    constraint that holds it, and all constraints that hold unknowns of this name share it. Raises
    ValueError if unknowns of one name differ, or a feature's and a constraint's share a name.
    """
    listed = [unknowns_of(player) for player in players]
    shared = constraint_unknowns(constraints)
    for i, own in enumerate(listed):
        for unknown in own:
            if unknown.name in shared:
                raise ValueError(
                    f"a feature of player {i} and a constraint hold unknowns of the name "
                    f"{unknown.name!r}: they are two numbers, so they need two names"
                )
    for unknown, player in shared.values():
        listed[player] = (*listed[player], unknown)
    return tuple(listed)


def _name(unknown: Unknown) -> str:
    return unknown.name


def _named(values: dict[str, float], unknown: Unknown) -> float:
    return values[unknown.name]


def trajectory_symbols(name: str, shape: tuple[int, int, int]) -> tuple[ca.SX, list[list[ca.SX]]]:
    """A flat symbol, in C order, of an array (steps, N, size); its blocks ``[step][player]``."""
    steps, players, size = shape
    flat = ca.SX.sym(name, steps * players * size)
    rows = ca.vertsplit(flat, size) if flat.numel() else []
    return flat, [rows[t * players : (t + 1) * players] for t in range(steps)]


def player_cost(
    game: Game, player: int, states: list[list[ca.SX]], controls: list[ca.SX], weights: ca.SX
) -> ca.SX:
    """J^i (eqn. nash): cost of player i over a whole trajectory; ValueError if it has unknowns.

    There are T rows of N state symbols, T-1 control symbols and a (K,) symbol of its weights.
    """
    model = game.players[player]
    if unknowns := game.parameters.unknowns[player]:
        raise ValueError(
            f"player {player} has unknowns ({', '.join(one.name for one in unknowns)}): "
            "its cost needs a game in which they are known (Game.known)"
        )
    cost = ca.SX(0)
    for row, control in zip(states[:-1], controls, strict=True):
        stage = Stage(player, tuple(row), control, game.dynamics, game.dt)
        cost += model.running_cost(stage, weights)
    last = Stage(player, tuple(states[-1]), None, game.dynamics, game.dt)
    return cost + model.final_cost(last, weights)

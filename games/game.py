"""A dynamic game: players, their cost features, one motion model, a horizon.

Weight layout
-------------
``weights`` is an array (N, K): row i belongs to player i, column k to ``game.weight_names[k]``,
which is the order of every player's ``preferences``. Weights are non-negative and only their
ratios matter to behaviour, so the convention is that each row sums to one. A player's ``task``
terms (its goal, its lane) encode what it has to do rather than what it likes: they are scaled by
the *mean* of its weights, which keeps the cost homogeneous in the weights.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from olne_bench.games.dynamics import Dynamics
from olne_bench.games.features import Feature, Stage


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
        return self._weigh(
            weights,
            [feature.running_cost(stage) for feature in self.preferences],
            [feature.running_cost(stage) for feature in self.task],
        )

    def final_cost(self, stage: Stage, weights: ca.SX) -> ca.SX:
        """Cost of the last state for weights (K,)."""
        return self._weigh(
            weights,
            [feature.final_cost(stage) for feature in self.preferences],
            [feature.final_cost(stage) for feature in self.task],
        )

    @staticmethod
    def _weigh(weights: ca.SX, preferences: list, task: list) -> ca.SX:
        mean = ca.sum1(weights) / len(preferences)
        return ca.dot(weights, ca.vertcat(*preferences)) + mean * sum(task)


@dataclass(frozen=True)
class Game:
    """An open-loop dynamic game without weights and initial state, hence without ground truth.

    Attributes:
        players: N players whose preferences carry the same names in the same order.
        dynamics: the motion model of every player.
        horizon: T, number of states of a trajectory, at least 2.
        dt: step [s], positive.

    Raises:
        ValueError: if a parameter is out of range or the players' preferences differ in name.
    """

    players: tuple[Player, ...]
    dynamics: Dynamics
    horizon: int
    dt: float

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
        if len(set(self.weight_names)) != len(self.weight_names):
            raise ValueError(f"preferences need different names, got {self.weight_names}")

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

        Raises:
            ValueError: on a wrong shape, a negative or non-finite entry, or a row of zeros.
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
        return weights / totals

    def check_initial_state(self, initial_state: np.ndarray) -> np.ndarray:
        """Initial state as float64 (N, n).

        Raises:
            ValueError: on a wrong shape or a non-finite entry.
        """
        initial_state = np.asarray(initial_state, dtype=float)
        expected = self.state_shape[1:]
        if initial_state.shape != expected:
            raise ValueError(
                f"initial_state has the shape {initial_state.shape}, expected {expected}"
            )
        if not np.isfinite(initial_state).all():
            raise ValueError(f"initial_state must be finite, got {initial_state.tolist()}")
        return initial_state


def trajectory_symbols(name: str, shape: tuple[int, int, int]) -> tuple[ca.SX, list[list[ca.SX]]]:
    """A flat symbol for an array (steps, N, size) and its blocks ``[step][player]``.

    The flat order is NumPy's C order, so values pass as ``array.ravel()`` and come back with
    ``reshape(shape)``.
    """
    steps, players, size = shape
    flat = ca.SX.sym(name, steps * players * size)
    rows = ca.vertsplit(flat, size) if flat.numel() else []
    return flat, [rows[t * players : (t + 1) * players] for t in range(steps)]


def player_cost(
    game: Game,
    player: int,
    states: list[list[ca.SX]],
    controls: list[ca.SX],
    weights: ca.SX,
) -> ca.SX:
    """J^i (eqn. nash): cost of one player over a whole trajectory, as an expression.

    Args:
        game: the game.
        player: index i.
        states: T rows of N state symbols.
        controls: T-1 control symbols of this player.
        weights: (K,) symbol of this player's weights.
    """
    model = game.players[player]
    cost = ca.SX(0)
    for row, control in zip(states[:-1], controls, strict=True):
        stage = Stage(player, tuple(row), control, game.dynamics, game.dt)
        cost += model.running_cost(stage, weights)
    last = Stage(player, tuple(states[-1]), None, game.dynamics, game.dt)
    return cost + model.final_cost(last, weights)

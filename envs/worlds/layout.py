"""Layout of a world's flat observation vectors, and the spaces of observations and actions.

An observation has one block of d numbers per player, the observer's own first, the others in the
order of their indices, and the time last::

    observation of player_1 of 3:  | player_1 (d) | player_0 (d) | player_2 (d) | time |

In a world without sensors a block is a state; views turn it into what a sensor reports.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Box

from olne_bench.envs.scenarios.scenario import Scenario

#: What a world tells each player besides its observation.
Infos: TypeAlias = dict[str, dict[str, Any]]
#: Results of ``reset`` and ``step``, by player: observations, rewards, whether it has terminated,
#: whether it is truncated, infos.
Start: TypeAlias = tuple[dict[str, np.ndarray], Infos]
Step: TypeAlias = tuple[
    dict[str, np.ndarray], dict[str, float], dict[str, bool], dict[str, bool], Infos
]


def player_name(index: int) -> str:
    """Name of a player in a world: ``player_0``, ``player_1``, ..."""
    return f"player_{index}"


def player_index(name: str) -> int:
    """Inverse of ``player_name``."""
    return int(name.rpartition("_")[2])


@dataclass(frozen=True)
class ObservationLayout:
    """The layout of an observation vector of N*d + 1 entries.

    It names the d components of a block as ``games.model.dynamics.Dynamics`` does, so observation
    models apply to blocks as they do to states.
    """

    state_names: tuple[str, ...]
    num_players: int

    @property
    def state_size(self) -> int:
        """d, the number of entries of a block."""
        return len(self.state_names)

    @property
    def size(self) -> int:
        """Length of an observation vector."""
        return self.num_players * self.state_size + 1

    def order(self, player: str) -> list[int]:
        """Player indices in the order of a player's observation."""
        own = player_index(player)
        return [own, *(i for i in range(self.num_players) if i != own)]

    def blocks(self, observation: np.ndarray) -> np.ndarray:
        """The blocks (N, d) of an observation, the observer's own first."""
        return observation[:-1].reshape(self.num_players, -1)

    def by_index(self, observation: np.ndarray, player: str) -> np.ndarray:
        """Blocks (N, d) of a player's observation by player index; over time, ``y`` (T, N, d)."""
        ordered = np.empty((self.num_players, self.state_size), observation.dtype)
        ordered[self.order(player)] = self.blocks(observation)
        return ordered


@dataclass(frozen=True)
class SpaceSize:
    """The parameters of a scenario's spaces."""

    layout: ObservationLayout  # of the observations
    control_names: tuple[str, ...]  # of the m components of an action
    control_limits: tuple[float, ...]  # (m,) largest magnitudes
    state_limits: tuple[float, ...]  # (n,) largest magnitudes
    duration: float  # of a whole episode [s]

    @classmethod
    def of(cls, scenario: Scenario) -> "SpaceSize":
        game, limits = scenario.game, scenario.limits
        if limits is None:
            raise ValueError(
                f"scenario {scenario.name!r} has no limits, which the spaces of a world need: "
                "give Scenario(..., limits=Limits(controls, states))"
            )
        return cls(
            layout=ObservationLayout(game.dynamics.state_names, game.num_players),
            control_names=game.dynamics.control_names,
            control_limits=limits.controls,
            state_limits=limits.states,
            duration=(game.horizon - 1) * game.dt,
        )


class Spaces:
    """Spaces of a world, which check the actions that it is given."""

    def __init__(self, size: SpaceSize) -> None:
        self.size = size
        self.layout = size.layout
        players = [player_name(i) for i in range(size.layout.num_players)]
        high = np.append(np.tile(size.state_limits, len(players)), size.duration)
        low = np.append(-high[:-1], 0.0)
        self._limits = np.array(size.control_limits)
        self.state = Box(low, high, dtype=np.float64)
        self.observations = {player: Box(low, high, dtype=np.float64) for player in players}
        self.actions = {
            player: Box(-self._limits, self._limits, dtype=np.float64) for player in players
        }
        columns = np.arange(self.layout.size - 1).reshape(len(players), -1)
        self.observation_order = {
            player: np.append(columns[self.layout.order(player)], self.layout.size - 1)
            for player in players
        }

    def of_player(self, player: str, spaces: Mapping[str, Box]) -> Box:
        """A player's space in one of the dictionaries; ValueError on an unknown player."""
        if player not in spaces:
            raise ValueError(f"unknown player {player!r}; players are: {', '.join(spaces)}")
        return spaces[player]

    def controls(self, actions: dict[str, np.ndarray], players: list[str]) -> np.ndarray:
        """Actions (m,) by player as controls (N, m), zero for players that have left the episode.

        ``players`` must act. The ValueError names the player, the value and the allowed range.
        """
        missing = [player for player in players if player not in actions]
        unknown = [str(player) for player in actions if player not in players]
        faults = [
            f"{fault} {', '.join(names)}"
            for fault, names in (("no action for", missing), ("unknown player", unknown))
            if names
        ]
        if faults:
            raise ValueError(f"{'; '.join(faults)}; players are: {', '.join(players)}")
        controls = np.zeros((len(self.actions), len(self._limits)))
        for row, player in zip(controls, self.actions, strict=True):
            if player in actions:
                row[:] = self._numbers(player, actions[player])
        outside = np.argwhere(~(np.abs(controls) <= self._limits))  # so is NaN
        for i, k in outside[:1]:
            limit = self._limits[k]
            raise ValueError(
                f"{self.size.control_names[k]} of {player_name(i)} is {controls[i, k]}, "
                f"must be within [{-limit}, {limit}]"
            )
        return controls

    def _numbers(self, player: str, action: np.ndarray) -> np.ndarray:
        names = ", ".join(self.size.control_names)
        expected = f"expected {len(self._limits)} numbers ({names})"
        try:
            numbers = np.asarray(action, dtype=float)
        except (TypeError, ValueError) as error:
            raise ValueError(f"action of {player} is {action!r}, {expected}") from error
        if numbers.shape != self._limits.shape:
            raise ValueError(f"action of {player} has the shape {numbers.shape}, {expected}")
        return numbers

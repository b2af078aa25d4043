"""Spaces of a world: built from a scenario's limits, they check actions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box

from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.worlds.layout import ObservationLayout, player_name


@dataclass(frozen=True)
class SpaceSize:
    """The parameters of a scenario's spaces.

    Attributes:
        layout: layout of the observations.
        control_names: names of the m components of an action.
        control_limits: (m,) largest magnitude of each control.
        state_limits: (n,) largest magnitude of each component of the state.
        duration: duration of a whole episode [s].
    """

    layout: ObservationLayout
    control_names: tuple[str, ...]
    control_limits: tuple[float, ...]
    state_limits: tuple[float, ...]
    duration: float

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
        """A player's space in one of the dictionaries of spaces.

        Raises:
            ValueError: on an unknown player.
        """
        if player not in spaces:
            raise ValueError(f"unknown player {player!r}; players are: {', '.join(spaces)}")
        return spaces[player]

    def controls(self, actions: dict[str, np.ndarray], players: list[str]) -> np.ndarray:
        """Actions as controls (N, m), zero for players that have left the episode.

        Args:
            actions: actions (m,) by player.
            players: players that must act.

        Raises:
            ValueError: with a message that names the player, the value and the allowed range.
        """
        if actions.keys() != set(players):
            self._raise_wrong_players(actions, players)
        controls = np.zeros((len(self.actions), len(self._limits)))
        for row, player in zip(controls, self.actions, strict=True):
            if player in actions:
                row[:] = self._numbers(player, actions[player])
        if not (np.abs(controls) <= self._limits).all():  # false for NaN as well
            self._raise_out_of_space(controls)
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

    @staticmethod
    def _raise_wrong_players(actions: dict[str, np.ndarray], players: list[str]) -> None:
        missing = [player for player in players if player not in actions]
        unknown = [str(player) for player in actions if player not in players]
        faults = [
            f"{fault} {', '.join(names)}"
            for fault, names in (("no action for", missing), ("unknown player", unknown))
            if names
        ]
        raise ValueError(f"{'; '.join(faults)}; players are: {', '.join(players)}")

    def _raise_out_of_space(self, controls: np.ndarray) -> None:
        i, k = np.argwhere(~(np.abs(controls) <= self._limits))[0]
        limit = self._limits[k]
        raise ValueError(
            f"{self.size.control_names[k]} of {player_name(i)} is {controls[i, k]}, "
            f"must be within [{-limit}, {limit}]"
        )

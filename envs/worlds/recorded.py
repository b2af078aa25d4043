"""A world that plays a recorded motion again: no game is played for it."""

from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv

from olne_bench.envs.worlds.layout import ObservationLayout, Start, Step, player_name


class RecordedWorld(ParallelEnv[str, np.ndarray, np.ndarray]):
    """A motion (S, N, n) in steps of dt [s], played again; actions have no effect.

    The only agent is the observer ``player_0``. It sees what it saw in the recorded world: all
    players in the order of their indices.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "recorded", "render_modes": []}

    def __init__(self, states: np.ndarray, state_names: tuple[str, ...], dt: float) -> None:
        flat = states.reshape(len(states), -1)
        self.render_mode = None
        self.possible_agents = [player_name(0)]
        self.agents: list[str] = []
        self._layout = ObservationLayout(state_names, states.shape[1])
        self._frames = np.column_stack([flat, dt * np.arange(len(flat))])
        self._frames.setflags(write=False)
        bounds = self._frames.min(axis=0), self._frames.max(axis=0)
        self.state_space = Box(*bounds, dtype=np.float64)
        self._idle = Box(-1.0, 1.0, (1,), dtype=np.float64)
        self._steps = 0

    @property
    def observation_layout(self) -> ObservationLayout:
        """Layout of the observations."""
        return self._layout

    def observation_space(self, agent: str) -> Box:
        return self.state_space

    def action_space(self, agent: str) -> Box:
        return self._idle

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Start:
        """Start again; seed and options have no effect here, but sensors use them."""
        self.agents, self._steps = self.possible_agents[:], 0
        return self._shown(), {self.possible_agents[0]: {}}

    def step(self, actions: dict[str, np.ndarray]) -> Step:
        """Play one step; actions are ignored."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        self._steps += 1
        over, player = self._steps == len(self._frames) - 1, self.possible_agents[0]
        if over:
            self.agents = []
        return self._shown(), {player: 0.0}, {player: over}, {player: False}, {player: {}}

    def state(self) -> np.ndarray:
        """All players' states in the order of their indices, then the time [s]."""
        return np.asarray(self._frames[self._steps])

    def render(self) -> None:
        """Do nothing: ``envs.worlds.rendering`` draws recordings."""

    def close(self) -> None:
        pass

    def _shown(self) -> dict[str, np.ndarray]:
        return {self.possible_agents[0]: self._frames[self._steps]}

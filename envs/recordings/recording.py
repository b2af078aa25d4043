"""Recordings: the motion of a world, with its ground truth, and a world that plays it again."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv

from olne_bench.envs.olne_v0 import OlneWorld, make_world
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.envs.worlds.layout import ObservationLayout, Start, Step, player_name
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.solve.newton import Root
from olne_bench.games.solve.olne import Certificate

__all__ = ["NoEquilibriumError", "Recording", "film", "record"]

#: How far a world may deviate from the equilibrium [m], [rad], [m/s]: rounding only.
PLAY_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Recording:
    """One episode.

    Attributes:
        scenario: the scenario that was played, ground truth included.
        states: (T, N, n) states that the world reported.
        controls: (T-1, N, m) controls that the world was given.
        costates: (T-1, N, n) costates of the equilibrium.
        extra_state: (N, n) state at T+1, one step beyond the horizon with zero controls. It is
            computed, as the episode is over by then.
        certificate: evidence that the motion is an equilibrium.
    """

    scenario: Scenario
    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    extra_state: np.ndarray
    certificate: Certificate

    @property
    def root(self) -> Root:
        """The motion as a root of the first-order conditions, as the certificate confirms."""
        return Root(self.states, self.controls, self.costates, residual=0.0)


def record(scenario: Scenario) -> Recording:
    """Play a scenario's equilibrium in its PettingZoo world.

    Raises:
        NoEquilibriumError: if the equilibrium is not certified or exceeds the scenario's limits, or
            if the world does not play it exactly, as after a collision.
        ValueError: on a scenario without ``limits``.
    """
    truth = certified_equilibrium(scenario)
    world = make_world(scenario)
    steps = list(_episode(world))
    world.close()
    states = np.stack([now for now, _ in steps])
    if len(states) < len(truth.states):
        raise NoEquilibriumError(
            f"players of {scenario.name!r} leave the world at step {len(states)} of "
            f"{len(truth.states)} of their equilibrium"
        )
    deviation = np.abs(states - truth.states).max()
    if not deviation < PLAY_TOLERANCE:
        raise NoEquilibriumError(
            f"the world plays {scenario.name!r} up to {deviation:.1e} away from its equilibrium"
        )
    game = scenario.game
    coast = np.zeros((1, *game.control_shape[1:]))
    return Recording(
        scenario=scenario,
        states=states,
        controls=np.stack([action for _, action in steps if action is not None]),
        costates=truth.costates,
        extra_state=rollout(game.dynamics, states[-1], coast, game.dt)[-1],
        certificate=truth.certificate,
    )


def film(scenario: Scenario) -> Iterator[np.ndarray]:
    """The frames (height, width, 3) uint8 of a scenario's equilibrium, one per state.

    Raises:
        NoEquilibriumError: as ``record``.
    """
    world = make_world(scenario, render_mode="rgb_array")
    try:
        for _ in _episode(world):
            frame = world.render()
            assert frame is not None, "worlds render arrays in this mode"
            yield frame
    finally:
        world.close()


def _episode(world: OlneWorld) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    """States (N, n) and the controls (N, m) that follow them; None at the end.

    It ends with the game, or when the first player leaves.
    """
    _, infos = world.reset()
    players, layout = world.agents, world.observation_layout
    while world.agents == players:
        controls = np.stack([infos[player]["olne_action"] for player in players])
        yield layout.blocks(world.state()), controls
        *_, infos = world.step(dict(zip(players, controls, strict=True)))
    yield layout.blocks(world.state()), None


class RecordedWorld(ParallelEnv[str, np.ndarray, np.ndarray]):
    """A recording, played again; actions have no effect.

    The only agent is the observer ``player_0``. It sees what it saw in the recorded world: all
    players in the order of their indices. The episode has one step more than the recording, to its
    extra state. Nothing is random.

    Args:
        recording: recording to play.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "recorded", "render_modes": []}

    def __init__(self, recording: Recording) -> None:
        game = recording.scenario.game
        states = np.concatenate([recording.states, recording.extra_state[None]])
        flat = states.reshape(len(states), -1)
        self.render_mode = None
        self.possible_agents = [player_name(0)]
        self.agents: list[str] = []
        self._layout = ObservationLayout(game.dynamics.state_names, game.num_players)
        self._frames = np.column_stack([flat, game.dt * np.arange(len(flat))])
        self._frames.setflags(write=False)
        bounds = self._frames.min(axis=0), self._frames.max(axis=0)
        self.state_space = Box(*bounds, dtype=np.float64)
        self._idle = Box(-1.0, 1.0, (game.dynamics.control_size,), dtype=np.float64)
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

"""Recordings: the motion of a world, with its ground truth."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from olne_bench.envs.olne_v0 import OlneWorld, make_world
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.envs.worlds.recorded import RecordedWorld
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
        controls: (T-1, N, m) of the equilibrium.
        costates: (T-1, N, n) of the equilibrium.
        extra_state: (N, n) at T+1, beyond the episode, computed with zero controls.
        certificate: evidence for the equilibrium.
        planned: (T, N, n) states of the equilibrium; None where they were driven.
        everybody: (M, n) last states with players that are not reported; None as ``planned``.
    """

    scenario: Scenario
    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    extra_state: np.ndarray
    certificate: Certificate
    planned: np.ndarray | None = None
    everybody: np.ndarray | None = None

    @property
    def root(self) -> Root:
        """The equilibrium, a root of the first-order conditions as the certificate confirms."""
        states = self.states if self.planned is None else self.planned
        return Root(states, self.controls, self.costates, residual=0.0)

    @property
    def all_states(self) -> np.ndarray:
        """(T+1, N, n) states and the extra one."""
        return np.concatenate([self.states, self.extra_state[None]])

    def world(self) -> RecordedWorld:
        """A world that plays it again, to its extra state."""
        game = self.scenario.game
        return RecordedWorld(self.all_states, game.dynamics.state_names, game.dt)


def record(scenario: Scenario) -> Recording:
    """Play a scenario's equilibrium in its PettingZoo world.

    Raises NoEquilibriumError if the equilibrium is not certified or exceeds the scenario's limits,
    or if the world does not play it exactly, as after a collision; ValueError on a scenario without
    ``limits``.
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
    controls = np.stack([action for _, action in steps if action is not None])
    root = Root(states, controls, truth.costates, truth.residual)
    return recorded(scenario, root, truth.certificate)


def recorded(scenario: Scenario, root: Root, certificate: Certificate) -> Recording:
    """The recording of an equilibrium, or of what is driven instead; else NoEquilibriumError."""
    own = Recording(
        scenario=scenario,
        states=root.states,
        controls=root.controls,
        costates=root.costates,
        extra_state=_coasting(scenario, root.states),
        certificate=certificate,
    )
    if scenario.departure is None:
        return own
    driven = scenario.departure.driven(root.states[0], len(root.states))
    states = driven[:, : scenario.game.num_players]
    return replace(
        own,
        states=states,
        extra_state=_coasting(scenario, states),
        planned=root.states,
        everybody=driven[-1],
    )


def _coasting(scenario: Scenario, states: np.ndarray) -> np.ndarray:
    """(N, n) one step beyond states (T, N, n), with zero controls."""
    game = scenario.game
    coast = np.zeros((1, *game.control_shape[1:]))
    return np.asarray(rollout(game.dynamics, states[-1], coast, game.dt)[-1])


def film(scenario: Scenario) -> Iterator[np.ndarray]:
    """Frames (height, width, 3) uint8 of an equilibrium, one per state; raises as ``record``."""
    world = make_world(scenario, render_mode="rgb_array")
    try:
        for _ in _episode(world):
            frame = world.render()
            assert frame is not None, "worlds render arrays in this mode"
            yield frame
    finally:
        world.close()


def _episode(world: OlneWorld) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    """States (N, n) and controls (N, m) that follow, None at the end or when a player leaves."""
    _, infos = world.reset()
    players, layout = world.agents, world.observation_layout
    while world.agents == players:
        controls = np.stack([infos[player]["olne_action"] for player in players])
        yield layout.blocks(world.state()), controls
        *_, infos = world.step(dict(zip(players, controls, strict=True)))
    yield layout.blocks(world.state()), None

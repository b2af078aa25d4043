"""The data of a scenario."""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.game import Game


class NoEquilibriumError(Exception):
    """No certified equilibrium was found for a scenario, so it cannot serve as ground truth."""


@dataclass(frozen=True)
class Limits:
    """Bounds of controls and states, the same for every draw of a family.

    Worlds build their spaces from them. Spaces must be finite and must not change with the seed.

    Attributes:
        controls: (m,) largest magnitude of each control that a world accepts.
        states: (n,) magnitude that no state component exceeds, whatever the controls.
    """

    controls: tuple[float, ...]
    states: tuple[float, ...]


@dataclass(frozen=True)
class Scenario:
    """A game with its ground truth.

    ``solve_olne(scenario.game, scenario.weights, scenario.initial_state)`` is the true motion.

    Attributes:
        name: name for ``get_scenario``.
        game: the game, without weights and initial state.
        weights: (N, K) true weights, rows sum to one.
        initial_state: (N, n) true x_1.
        limits: bounds of a world's spaces; required to play the scenario.
        world: module of ``envs`` whose ``parallel_env`` plays the scenario.
        noise_scale: (n,) standard deviation of a sensor's noise on each component of the state,
            relative to that on a position [m]. Default: ones, as in the paper.

    Raises:
        ValueError: on arrays of a wrong shape, or noise scales that are not positive.
    """

    name: str
    game: Game
    weights: np.ndarray
    initial_state: np.ndarray
    limits: Limits | None = None
    world: str = "olne_v0"
    noise_scale: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", self.game.check_weights(self.weights))
        state = self.game.check_initial_state(self.initial_state)
        object.__setattr__(self, "initial_state", state)
        size = self.game.dynamics.state_size
        scale = tuple(float(value) for value in self.noise_scale) or (1.0,) * size
        if len(scale) != size or not (np.isfinite(scale).all() and min(scale) > 0):
            raise ValueError(
                f"noise_scale of {self.name!r} must hold {size} positive numbers, one for each of "
                f"{', '.join(self.game.dynamics.state_names)}, got {self.noise_scale}"
            )
        object.__setattr__(self, "noise_scale", scale)

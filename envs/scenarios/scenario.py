"""What a scenario is."""

from dataclasses import dataclass

import numpy as np

from olne_bench.games.game import Game


class NoEquilibriumError(Exception):
    """A scenario for which no certified equilibrium was found; it must not serve as truth."""


@dataclass(frozen=True)
class Limits:
    """How far controls and states can go, the same for every draw of a family.

    Worlds build their spaces from it, which have to be finite and must not change with the seed.

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
        name: name under which ``get_scenario`` knows it.
        game: the game without its truth.
        weights: (N, K) true weights, rows sum to one.
        initial_state: (N, n) true x_1.
        limits: sizes of a world's spaces; needed to play the scenario.
        world: module of ``envs`` whose ``parallel_env`` plays the scenario.
        noise_scale: (n,) standard deviation of a sensor's noise on each component of the state,
            relative to that on a position [m]; ones where absent, as in the paper.

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

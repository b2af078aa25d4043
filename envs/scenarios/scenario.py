"""The data of a scenario."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from olne_bench.games.model.game import Game
from olne_bench.games.model.unknowns import Parameters
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

#: Standard deviations beyond which a normal prior has no mass: its tails have 1e-15.
FARTHEST = 8.0


class NoEquilibriumError(Exception):
    """No equilibrium, certified locally and globally so far, that could serve as ground truth."""


@dataclass(frozen=True)
class Limits:
    """Bounds of controls and states, the same for every draw of a family, for the spaces of worlds.

    Attributes:
        controls: (m,) largest magnitude of each control that a world accepts.
        states: (n,) magnitude that no state component exceeds, whatever the controls.
    """

    controls: tuple[float, ...]
    states: tuple[float, ...]


class Departure(Protocol):
    """How a world differs from what estimators are told; ``envs.changes`` has some."""

    def driven(self, start: np.ndarray, horizon: int) -> np.ndarray:
        """The motion (T, M, n) from states (N, n) of the reported players, or of all M."""

    def disturbed(
        self, errors: np.ndarray, clean: np.ndarray, deviations: np.ndarray
    ) -> np.ndarray:
        """Errors of samples (S, N, d) in place of those that estimators are told of."""


@dataclass(frozen=True)
class Scenario:
    """A game with its ground truth.

    ``solve_olne(scenario.game, scenario.weights, scenario.initial_state)`` is the true motion.
    Raises ValueError on arrays of a wrong shape, noise scales that are not positive, or parameters
    that are out of their ranges, are where their prior has no mass, or do not make ``asked`` the
    same as ``game``.

    Attributes:
        name: name for ``get_scenario``.
        game: the game, without weights and initial state.
        weights: (N, K) true weights, rows sum to one.
        initial_state: (N, n) true x_1.
        limits: bounds of a world's spaces; required to play the scenario.
        world: module of ``envs`` whose ``parallel_env`` plays the scenario.
        noise_scale: (n,) standard deviation of a sensor's noise on each component of the state,
            relative to that on a position [m]. Default: ones, as in the paper.
        asked: the game that estimators are told of, with unknowns in place of numbers of ``game``;
            None where only weights are unknown.
        parameters: (N, U) true values of these unknowns, in their units; None where there are none.
        prior: what estimators are told of each player's weights: how they are drawn, or near it.
        departure: how the world differs from all of this; None where it does not.
    """

    name: str
    game: Game
    weights: np.ndarray
    initial_state: np.ndarray
    limits: Limits | None = None
    world: str = "olne_v0"
    noise_scale: tuple[float, ...] = ()
    asked: Game | None = None
    parameters: np.ndarray | None = None
    prior: WeightPrior = FLAT
    departure: Departure | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", self.game.check_weights(self.weights))
        self.prior.check(self.game.num_weights)
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
        self._check_parameters()

    def _check_parameters(self) -> None:
        if (self.asked is None) != (self.parameters is None):
            raise ValueError(f"scenario {self.name!r} needs both asked and parameters, or neither")
        if self.asked is None or self.parameters is None:
            return
        values = self.asked.parameters.check(self.parameters)
        object.__setattr__(self, "parameters", values)
        self._check_prior(self.asked.parameters, values)
        if self.asked.known(values) != self.game:
            raise ValueError(f"the parameters of {self.name!r} do not make asked the same as game")

    def _check_prior(self, known: Parameters, values: np.ndarray) -> None:
        for player, own in enumerate(known.unknowns):
            for unknown, value in zip(own, values[player], strict=False):
                if abs(unknown.standardised(value)) > FARTHEST:
                    raise ValueError(
                        f"the prior of {unknown.name!r} of player {player} of {self.name!r} gives "
                        f"the truth no mass: {value:g} {unknown.unit} is more than {FARTHEST:g} "
                        f"deviations of {unknown.deviation:g} from its mean {unknown.mean:g}; "
                        "move the mean or widen the deviation"
                    )

    def __repr__(self) -> str:
        """One line: its name and the game that estimators are told of."""
        return f"{type(self).__name__}({self.name!r}: {self.told!r}; true weights are known)"

    @property
    def told(self) -> Game:
        """The game that estimators are told of."""
        return self.game if self.asked is None else self.asked

    @property
    def theta(self) -> np.ndarray:
        """(N, K + U): weights and standardised parameters, as solvers of ``told`` take them."""
        if self.parameters is None:
            return self.weights
        return np.hstack([self.weights, self.told.parameters.standardised(self.parameters)])

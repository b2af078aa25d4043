"""What a change of a scenario is, and the departure of a draw that it makes."""

import zlib
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.game import Game
from olne_bench.games.solve.kkt import consistent_costates
from olne_bench.games.solve.newton import Root, newton_root
from olne_bench.games.solve.olne import certify, solve_olne

#: Rounds of best responses before a world gives up on an equilibrium.
_ROUNDS = 30


@dataclass(frozen=True)
class Samples:
    """What is seen in S steps.

    Attributes:
        errors: (S, N, d) as the noise that estimators are told of; NaN where nothing is seen.
        clean: (S, N, d) what is seen without noise.
        deviations: (d,) standard deviations of that noise.
    """

    errors: np.ndarray
    clean: np.ndarray
    deviations: np.ndarray


@dataclass(frozen=True)
class Change:
    """A change of a scenario; this one changes nothing.

    Attributes:
        dial: how far it goes, in ``unit``, from ``low`` to ``high``; 0 is the true model.

    Raises:
        ValueError: on a dial out of its range.
    """

    name: ClassVar[str]
    unit: ClassVar[str] = ""
    low: ClassVar[float] = 0.0
    high: ClassVar[float]

    dial: float

    def __post_init__(self) -> None:
        number = isinstance(self.dial, int | float) and not isinstance(self.dial, bool)
        if not (number and self.low <= self.dial <= self.high):
            unit = f" {self.unit}" if self.unit else ""
            raise ValueError(
                f"the dial of {self.name!r} must be from {self.low:g} to {self.high:g}{unit}, "
                f"got {self.dial!r}"
            )

    def told(self, scenario: Scenario) -> Scenario:
        """What estimators are told of a drawn scenario: all of it, unless players are left out."""
        return scenario

    @property
    def unreported(self) -> int:
        """Number of players whom estimators are not told of."""
        return 0

    def drive(
        self, scenario: Scenario, start: np.ndarray, horizon: int, rng: np.random.Generator
    ) -> np.ndarray:
        """The motion (T, N, n) that the players drive from a start (N, n).

        Args:
            scenario: the drawn scenario.
            start: initial states.
            horizon: T.
            rng: for what is random.

        Raises:
            NoEquilibriumError: where no motion is found.
        """
        return own_plan(scenario, start, horizon).states

    def disturb(self, seen: Samples, rng: np.random.Generator) -> np.ndarray:
        """The errors (S, N, d) that samples have, in place of those of the noise as told."""
        return seen.errors


def own_plan(scenario: Scenario, start: np.ndarray, horizon: int) -> Root:
    """The equilibrium that the players would play from a start (N, n): the certified one at theirs.

    Raises:
        NoEquilibriumError: if none is found.
    """
    if horizon == scenario.game.horizon and np.array_equal(start, scenario.initial_state):
        found = certified_equilibrium(scenario)
        return Root(found.states, found.controls, found.costates, found.residual)
    return played(scenario.game, scenario.weights, start, horizon)


def played(
    game: Game,
    weights: np.ndarray,
    start: np.ndarray,
    horizon: int,
    controls: np.ndarray | None = None,
) -> Root:
    """The equilibrium over T = ``horizon`` states that is next to plans (T-1, N, m), or any.

    Raises:
        NoEquilibriumError: if no certified one is found.
    """
    game = game if horizon == game.horizon else replace(game, horizon=horizon)
    if controls is not None and not game.constraints:
        states = rollout(game.dynamics, start, controls, game.dt)
        costates = consistent_costates(game, states, controls, weights)
        root = newton_root(game, states, controls, costates, weights)
        if certify(game, root, weights).passed:
            return root
    found = solve_olne(game, weights, start, initial_controls=controls, max_rounds=_ROUNDS)
    if not found.certificate.passed:
        raise NoEquilibriumError("the changed world has no certified equilibrium here")
    return Root(found.states, found.controls, found.costates, found.residual)


@dataclass(frozen=True)
class Departed:
    """How the world of a draw departs from what estimators are told (``Scenario.departure``).

    Attributes:
        change: what is different.
        drawn: the scenario with all of its players, also those that are not reported.
        seed: of what is random.
    """

    change: Change
    drawn: Scenario
    seed: int

    def driven(self, start: np.ndarray, horizon: int) -> np.ndarray:
        """The motion (T, M, n) of all M players from states of the reported ones, or of all."""
        rest = self.drawn.initial_state[len(start) :]
        return self.change.drive(
            self.drawn, np.concatenate([start, rest]), horizon, self._rng(start)
        )

    def disturbed(
        self, errors: np.ndarray, clean: np.ndarray, deviations: np.ndarray
    ) -> np.ndarray:
        """Errors (S, N, d) in place of those that estimators are told of."""
        return self.change.disturb(Samples(errors, clean, deviations), self._rng(errors))

    def _rng(self, place: np.ndarray) -> np.random.Generator:
        return np.random.default_rng([self.seed, zlib.crc32(place.tobytes())])

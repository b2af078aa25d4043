"""One run through a game, step by step, on the game's own dynamics."""

import numpy as np

from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.games.compiled.buffered import BufferedFunction
from olne_bench.games.model.dynamics import numeric_step
from olne_bench.games.model.stage_costs import stage_costs
from olne_bench.games.model.violations import violations
from olne_bench.games.solve.olne import Equilibrium


class Episode:
    """One run through a game, whose equilibrium is None if the truth is hidden.

    ``history`` holds the states (N, n) of all steps so far, ``left`` the indices of players that
    left before the horizon, as after a crash in a simulator. On the game's own dynamics no player
    leaves.
    """

    def __init__(self, scenario: Scenario, truth: Equilibrium | None) -> None:
        self.scenario = scenario
        self.truth = truth
        self.states = scenario.initial_state
        self.history = [self.states]
        self.steps = 0
        self.left: frozenset[int] = frozenset()
        self._played: tuple[np.ndarray, np.ndarray] | None = None
        game = scenario.game
        costs = stage_costs(game)
        self._step = BufferedFunction(numeric_step(game.dynamics, game.dt).map(game.num_players))
        self._running_costs = BufferedFunction(costs.running)
        self._final_costs = BufferedFunction(costs.final)

    @property
    def over(self) -> bool:
        """Whether the horizon is reached."""
        return self.steps == self.scenario.game.horizon - 1

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.steps * self.scenario.game.dt

    def advance(self, controls: np.ndarray) -> np.ndarray:
        """Play controls (N, m) for one step, which costs the players (N,)."""
        weights = self.scenario.weights
        costs = self._running_costs(self.states, controls, weights)[0]
        self._played = self.states, controls
        self.states = self._move(controls)
        self.history.append(self.states)
        self.steps += 1
        if self.over:
            costs += self._final_costs(self.states, weights)[0]
        return np.asarray(costs)

    def _move(self, controls: np.ndarray) -> np.ndarray:
        """The states after controls (N, m)."""
        return self._step(self.states, controls)

    def violations(self) -> np.ndarray:
        """Violation of each constraint (constraints,) by the present states and last controls."""
        return violations(self.scenario.game, self.steps, self.states, self._played)

    def vector(self) -> np.ndarray:
        """States and time in one vector (N*n + 1,)."""
        return np.append(self.states, self.time)

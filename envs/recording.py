"""Recordings: what a world was seen to do, with the truth beside it."""

from dataclasses import dataclass

import numpy as np

from envs.equilibrium import NoEquilibriumError, certified_equilibrium
from envs.scenarios.scenario import Scenario
from games.dynamics import rollout
from games.olne import Certificate

__all__ = ["NoEquilibriumError", "Recording", "record"]


@dataclass(frozen=True)
class Recording:
    """One episode.

    Attributes:
        scenario: the scenario that was played, ground truth included.
        states: (T, N, n).
        controls: (T-1, N, m).
        costates: (T-1, N, n).
        extra_state: (N, n) at T+1, one step beyond the horizon with zero controls.
        certificate: evidence that the motion is an equilibrium.
    """

    scenario: Scenario
    states: np.ndarray
    controls: np.ndarray
    costates: np.ndarray
    extra_state: np.ndarray
    certificate: Certificate


def record(scenario: Scenario) -> Recording:
    """Play a scenario's equilibrium.

    Raises:
        NoEquilibriumError: where the equilibrium is not certified.
    """
    game = scenario.game
    truth = certified_equilibrium(scenario)
    coast = np.zeros((1, *game.control_shape[1:]))
    extra_state = rollout(game.dynamics, truth.states[-1], coast, game.dt)[-1]
    return Recording(
        scenario, truth.states, truth.controls, truth.costates, extra_state, truth.certificate
    )

"""What there is to see of a scenario besides its vehicles: goals, lanes, headings."""

import numpy as np

from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.games.features import FinalGoal, StateDeviation


def goals(scenario: Scenario) -> dict[int, np.ndarray]:
    """Goal position (2,) of each player that has one."""
    return {
        i: np.array(feature.goal)
        for i, player in enumerate(scenario.game.players)
        for feature in player.task
        if isinstance(feature, FinalGoal)
    }


def lanes(scenario: Scenario) -> list[float]:
    """Where lanes along y are that players keep to, from left to right."""
    return sorted(
        {
            float(feature.target)
            for player in scenario.game.players
            for feature in player.task
            if isinstance(feature, StateDeviation) and feature.component == "px"
        }
    )


def heading_of(state: np.ndarray, names: tuple[str, ...]) -> float:
    """Where a vehicle points [rad]: its heading, or along its velocity."""
    if "heading" in names:
        return float(state[names.index("heading")])
    if "vx" in names:
        return float(np.arctan2(state[names.index("vy")], state[names.index("vx")]))
    return 0.0

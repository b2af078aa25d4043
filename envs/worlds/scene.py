"""What pictures of a scenario show besides its motion: goals, lanes, headings, colours, sizes."""

import numpy as np

from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.games.model.costs import FinalGoal, StateDeviation

#: A colour per player, the same in frames, figures and pages. None is close to a colour of an
#: estimator.
PLAYER_COLOURS = (
    *("#7A3FD1", "#E8307F", "#4C9A12", "#B4160B"),
    *("#8C8BEA", "#C45BEE", "#2450DD", "#C11FA6"),
)


def player_colour(player: int) -> str:
    """Colour of a player, as ``#rrggbb``."""
    return PLAYER_COLOURS[player % len(PLAYER_COLOURS)]


def is_on_road(scenario: Scenario) -> bool:
    """Whether HighwayEnv plays the scenario: y points down in pictures, and cars have a size."""
    return scenario.world == "highway_v0"


def car_outline(state: np.ndarray) -> np.ndarray:
    """Corners (4, 2) [m] of HighwayEnv's car at a state (px, py, heading, speed)."""
    from highway_env.vehicle.kinematics import Vehicle  # slow, and for roads only

    cos, sin = np.cos(state[2]), np.sin(state[2])
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
    corners = corners * (Vehicle.LENGTH, Vehicle.WIDTH)
    outline: np.ndarray = state[:2] + corners @ np.array([[cos, sin], [-sin, cos]])
    return outline


def goals(scenario: Scenario) -> dict[int, np.ndarray]:
    """Goal position (2,) of each player that has one."""
    return {
        i: np.array(feature.goal)
        for i, player in enumerate(scenario.game.players)
        for feature in player.task
        if isinstance(feature, FinalGoal)
    }


def lanes(scenario: Scenario) -> list[float]:
    """Positions px [m] of the lanes along y that players keep to, in ascending order."""
    return sorted(
        {
            float(feature.target)
            for player in scenario.game.players
            for feature in player.task
            if isinstance(feature, StateDeviation) and feature.component == "px"
        }
    )


def heading_of(state: np.ndarray, names: tuple[str, ...]) -> float:
    """Direction of a vehicle [rad]: its heading, or that of its velocity."""
    if "heading" in names:
        return float(state[names.index("heading")])
    if "vx" in names:
        return float(np.arctan2(state[names.index("vy")], state[names.index("vx")]))
    return 0.0

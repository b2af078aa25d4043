"""A seeded family of crossings: N vehicles with random goals, weights and speeds.

The players start around a circle and head, roughly, for the other side, so that they meet in the
middle. Same cost features and units as ``two_player``.
"""

import numpy as np

from olne_bench.envs.scenarios.scenario import Limits, Scenario, check_count
from olne_bench.games.dynamics import UNICYCLE
from olne_bench.games.features import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.game import Game, Player

HORIZON = 25
DT = 0.25  # [s]
PLAYERS = (2, 3, 4)  # drawn from these where the number is not given
WEIGHT_RANGE = (0.2, 1.0)
SPEED_RANGE = (0.05, 0.3)  # [m/s]
RADIUS_RANGE = (0.9, 1.3)  # [m] of starts and goals
GOAL_SPREAD = np.deg2rad(35)  # [rad] around the opposite side
HEADING_SPREAD = np.deg2rad(15)  # [rad] around the direction to the goal
#: Controls well beyond what equilibria use; states that these can reach.
LIMITS = Limits(controls=(2 * np.pi, 2.0), states=(38.0, 38.0, 42.0, 13.0))


def make(seed: int = 0, num_players: int | None = None) -> Scenario:
    """One draw.

    Args:
        seed: of the draw.
        num_players: N, at least 1; drawn as well where absent.
    """
    if num_players is not None:
        check_count("num_players", num_players)
        if num_players < 1:
            raise ValueError(f"num_players must be at least 1, got {num_players}")
    rng = np.random.default_rng([seed, num_players or 0])
    count = num_players or int(rng.choice(PLAYERS))

    slots = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count
    angles = slots + rng.uniform(-0.25, 0.25, count) * 2 * np.pi / count
    starts = _on_circle(angles, rng.uniform(*RADIUS_RANGE, count))
    opposite = angles + np.pi + rng.uniform(-GOAL_SPREAD, GOAL_SPREAD, count)
    goals = _on_circle(opposite, rng.uniform(*RADIUS_RANGE, count))
    direction = np.arctan2(*(goals - starts).T[::-1])
    headings = direction + rng.uniform(-HEADING_SPREAD, HEADING_SPREAD, count)
    speeds = rng.uniform(*SPEED_RANGE, count)

    return Scenario(
        name="random",
        game=Game(tuple(_player(goal) for goal in goals), UNICYCLE, HORIZON, DT),
        weights=rng.uniform(*WEIGHT_RANGE, (count, 4)),
        initial_state=np.column_stack([starts, headings, speeds]),
        limits=LIMITS,
    )


def _on_circle(angles: np.ndarray, radii: np.ndarray) -> np.ndarray:
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def _player(goal: np.ndarray) -> Player:
    return Player(
        preferences=(
            Proximity(),
            StateDeviation("speed"),
            ControlEffort("acceleration", scale=10.0),
            ControlEffort("yaw_rate"),
        ),
        task=(FinalGoal((float(goal[0]), float(goal[1]))),),
    )

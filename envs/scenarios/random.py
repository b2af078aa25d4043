"""A seeded family of crossings: N vehicles with random goals, weights and speeds.

The players start around a circle and head roughly for the other side, so that they meet in the
middle. Cost features and units are those of ``two_player``.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from olne_bench.checks import as_text, check_whole
from olne_bench.envs.scenarios.scenario import Limits, Scenario
from olne_bench.envs.scenarios.true_weights import (
    DIRICHLET,
    MODERATE,
    MODERATE_PRIOR,
    check_kind,
    flat_dirichlet,
)
from olne_bench.envs.scenarios.two_player import WIDE_LIMITS
from olne_bench.games.model.costs import ControlEffort, FinalGoal, Proximity, StateDeviation
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.weight_prior import FLAT

HORIZON = 25
DT = 0.25  # [s]
PLAYERS = (2, 3, 4)  # numbers to draw from if none is given
MOST_PLAYERS = 50  # more take hours to solve
WEIGHT_RANGE = (0.2, 1.0)
SPEED_RANGE = (0.05, 0.3)  # [m/s]
RADIUS_RANGE = (0.9, 1.3)  # [m] of starts and goals
GOAL_SPREAD = np.deg2rad(35)  # [rad] around the opposite side
HEADING_SPREAD = np.deg2rad(15)  # [rad] around the direction to the goal
#: Controls well beyond those of equilibria, and states that they can reach.
LIMITS = Limits(controls=(2 * np.pi, 2.0), states=(38.0, 38.0, 42.0, 13.0))


@dataclass(frozen=True)
class Random:
    """Players that cross; each seed draws others."""

    name: ClassVar[str] = "random"
    num_players: int | None = None  # N, 1 to 50; drawn if None
    #: ``moderate``, each from 0.2 to 1 before they are scaled, or ``dirichlet`` for weights
    #: that are uniform on the simplex.
    weights: str = MODERATE

    def __post_init__(self) -> None:
        check_kind(self.weights, (MODERATE, DIRICHLET))
        if self.num_players is not None:
            check_whole("num_players", self.num_players)
            if not 1 <= self.num_players <= MOST_PLAYERS:
                given = as_text(self.num_players)
                raise ValueError(f"num_players must be 1 to {MOST_PLAYERS}, got {given}")

    def draw(self, seed: int = 0) -> Scenario:
        """The member of a seed."""
        rng = np.random.default_rng([seed, self.num_players or 0])
        count = self.num_players or int(rng.choice(PLAYERS))

        slots = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(count) / count
        angles = slots + rng.uniform(-0.25, 0.25, count) * 2 * np.pi / count
        starts = _on_circle(angles, rng.uniform(*RADIUS_RANGE, count))
        opposite = angles + np.pi + rng.uniform(-GOAL_SPREAD, GOAL_SPREAD, count)
        goals = _on_circle(opposite, rng.uniform(*RADIUS_RANGE, count))
        direction = np.arctan2(*(goals - starts).T[::-1])
        headings = direction + rng.uniform(-HEADING_SPREAD, HEADING_SPREAD, count)
        speeds = rng.uniform(*SPEED_RANGE, count)

        weights = rng.uniform(*WEIGHT_RANGE, (count, 4))
        if self.weights == DIRICHLET:
            weights = flat_dirichlet(seed, *weights.shape)
        return Scenario(
            name=self.name,
            game=Game(tuple(_player(goal) for goal in goals), UNICYCLE, HORIZON, DT),
            weights=weights,
            initial_state=np.column_stack([starts, headings, speeds]),
            limits=WIDE_LIMITS if self.weights == DIRICHLET else LIMITS,
            prior=FLAT if self.weights == DIRICHLET else MODERATE_PRIOR,
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

"""Cars in one lane, each of which minds the speed of the one ahead of it.

The first car has no leader and drives at its target speed. What others want is between the speed of
their leader and their own target. ``explain`` gives recorded drivers these costs.
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
from olne_bench.games.model.costs import ControlEffort, Following, StateDeviation
from olne_bench.games.model.dynamics import bicycle
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.lanes import Lane, LaneKeeping, StraightLane
from olne_bench.games.model.weight_prior import FLAT

CAR = bicycle(rear_axle=2.5)
HORIZON = 15
DT = 0.4  # [s]
MOST_PLAYERS = 20
GAP = (12.0, 30.0)  # [m] between the centres of neighbours
TARGETS = (12.0, 22.0)  # [m/s] target speeds
SPEED_SPREAD = 3.0  # [m/s] of first speeds around the leader's
OFFSET_SPREAD = 0.4  # [m] of first positions beside the lane
WEIGHT_RANGE = (0.2, 1.0)
LIMITS = Limits(controls=(1.0, 12.0), states=(2000.0, 500.0, 100.0, 100.0))
#: Differences that cost 1: of the leader's speed and the target's [m/s], of acceleration [m/s^2],
#: steering [rad], beside the lane [m], of headings [rad]. With the first three and equal weights
#: recorded drivers are predicted best (docs/people.md).
LEADER, SPEED, ACCELERATION, STEERING, LANE, HEADING = 2.0, 4.5, 1.0, 0.03, 1.0, 0.1
#: As on HighwayEnv's roads: speeds and headings estimated over one second at 10 m/s.
NOISE_SCALE = (1.0, 1.0, 0.1, 1.0)


@dataclass(frozen=True)
class FollowingScenario:
    """Cars in one lane; each seed draws gaps, speeds, target speeds and weights."""

    name: ClassVar[str] = "following"
    num_players: int = 3  # N, 1 to 20
    #: ``moderate``, each from 0.2 to 1 before they are scaled, or ``dirichlet`` for weights
    #: that are uniform on the simplex.
    weights: str = MODERATE

    def __post_init__(self) -> None:
        check_kind(self.weights, (MODERATE, DIRICHLET))
        check_whole("num_players", self.num_players)
        if not 1 <= self.num_players <= MOST_PLAYERS:
            given = as_text(self.num_players)
            raise ValueError(f"num_players must be 1 to {MOST_PLAYERS}, got {given}")

    def draw(self, seed: int = 0) -> Scenario:
        """The member of a seed."""
        rng, count = np.random.default_rng([seed, self.num_players]), self.num_players
        behind = np.concatenate([[0.0], np.cumsum(rng.uniform(*GAP, count - 1))])
        speeds = rng.uniform(*TARGETS) + rng.uniform(-SPEED_SPREAD, SPEED_SPREAD, count)
        beside = rng.uniform(-OFFSET_SPREAD, OFFSET_SPREAD, count)
        lane = (StraightLane((0.0, 0.0), (1.0, 0.0), 1000.0),)
        players = tuple(
            driver(index - 1, target, lane)
            for index, target in enumerate(rng.uniform(*TARGETS, count))
        )
        drawn = rng.uniform(*WEIGHT_RANGE, (count, 4))
        is_flat = self.weights == DIRICHLET
        return Scenario(
            name=self.name,
            game=Game(players, CAR, HORIZON, DT),
            weights=flat_dirichlet(seed, count, 4) if is_flat else drawn,
            initial_state=np.column_stack([-behind, beside, np.zeros(count), speeds]),
            limits=LIMITS,
            noise_scale=NOISE_SCALE,
            prior=FLAT if is_flat else MODERATE_PRIOR,
        )


def driver(leader: int, target_speed: float, route: tuple[Lane, ...], dt: float = DT) -> Player:
    """Costs of a driver behind the player of that index, -1 for none, at steps of dt [s]."""
    return Player(
        preferences=(
            Following(leader, scale=LEADER**-2),
            StateDeviation("speed", target=float(target_speed), scale=SPEED**-2),
            ControlEffort("acceleration", scale=(dt * ACCELERATION) ** -2),
            ControlEffort("steering", scale=(dt * STEERING) ** -2),
        ),
        task=(LaneKeeping(route, width=LANE, heading_scale=HEADING**-2),),
    )

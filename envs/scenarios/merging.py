"""Ramp merging with hard distances, the field's benchmark of constrained games.

Le Cleac'h, Schwager, Manchester: ALGAMES, Autonomous Robots 2022; in their normalised units. Three
vehicles, one of them on the ramp, want the same lane, heading and speed, and keep their distance.
Costs do not look at other players: all interaction is in the constraints.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, cast

import numpy as np

from olne_bench.envs.scenarios.player_numbers import PlayerNumber, player_number, player_range
from olne_bench.envs.scenarios.scenario import Limits, NoEquilibriumError, Scenario
from olne_bench.envs.scenarios.true_weights import (
    DIRICHLET,
    MODERATE,
    MODERATE_PRIOR,
    PUBLISHED,
    check_kind,
    flat_dirichlet,
)
from olne_bench.games.model.constraints import Distance
from olne_bench.games.model.costs import ControlEffort, Tracking
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.unknowns import Unknown

HORIZON = 41
DT = 3.0 / (HORIZON - 1)  # [s]
LANE, HEADING, SPEED = -0.05, 0.0, 0.6  # targets [m], [rad], [m/s]
RUNNING, FINAL = 0.1 * DT, 1.0  # weights of half the squared deviations and controls
RADIUS = 0.08  # [m] of each vehicle
STARTS = np.array(
    [
        [-0.8, -0.05, 0.0, 0.6],
        [-1.0, -0.05, 0.0, 0.6],
        [-0.9, -0.3, np.pi / 12, 0.63],
        [-1.2, -0.05, 0.0, 0.6],
    ]
)  # px, py [m], heading [rad], speed [m/s]; the fourth follows in the lane
SPREAD = np.array([0.06, 0.06, np.deg2rad(5), 0.05])  # half-widths of the draws around the starts
WEIGHTS = (0.2, 1.0)
PLAYERS = (3, 4)
#: What is known of an unknown diameter. Draws stay a little within its range.
DIAMETER = Unknown("diameter", "m", low=0.1, high=0.22, mean=2 * RADIUS, deviation=0.02)
SMALLEST, LARGEST = 0.11, 0.21  # [m]
#: Controls well beyond those of equilibria, and states that they can reach.
LIMITS = Limits(controls=(2 * np.pi, 4.0), states=(39.0, 39.0, 20.0, 13.0))


@dataclass(frozen=True)
class Merging:
    """A vehicle on a ramp merges between others; each seed draws other starts.

    Seed 0 is the nominal start. One draw in five is infeasible: a pair touches at the start, or
    after the first step, which no control changes.
    """

    name: ClassVar[str] = "merging"
    num_players: PlayerNumber = 3  # N, 3 or 4; or ``drawn``, or the fewest and the most
    #: ``published`` for equal ones; ``moderate``, each from 0.2 to 1 before they are scaled; or
    #: ``dirichlet`` for weights that are uniform on the simplex.
    weights: str = PUBLISHED
    #: Whether nobody tells estimators how far vehicles stay apart. The distance between two of
    #: them, the diameter of one, is then an unknown of the constraints, and each seed draws
    #: another.
    unknown_radius: bool = False

    def __post_init__(self) -> None:
        player_range(self.name, self.num_players, *PLAYERS)
        check_kind(self.weights, (PUBLISHED, MODERATE, DIRICHLET))
        if not isinstance(self.unknown_radius, bool):
            raise ValueError(f"unknown_radius must be true or false, got {self.unknown_radius!r}")

    def draw(self, seed: int = 0) -> Scenario:
        """The member of a seed; NoEquilibriumError if the draw is infeasible."""
        count = player_number(player_range(self.name, self.num_players, *PLAYERS), seed)
        start, weights = STARTS[:count], None
        if seed:
            rng = np.random.default_rng([seed, count])
            start = start + SPREAD * rng.uniform(-1, 1, start.shape)
        if self.weights == MODERATE:
            weights = np.random.default_rng([seed, count, 1]).uniform(*WEIGHTS, (count, 5))
        elif self.weights == DIRICHLET:
            weights = flat_dirichlet(seed, count, 5)
        diameter = 2 * RADIUS
        if self.unknown_radius:
            rng = np.random.default_rng([seed, count, 2])
            spread = DIAMETER.deviation * rng.standard_normal()
            diameter = float(np.clip(DIAMETER.mean + spread, SMALLEST, LARGEST))
        if touch := touching(start, diameter):
            raise NoEquilibriumError(f"draw {seed} of merging is infeasible: {touch}")
        drawn = scenario(start, weights, diameter)
        if self.weights == MODERATE:
            drawn = replace(drawn, prior=MODERATE_PRIOR)
        return asking_for_the_diameter(drawn, diameter) if self.unknown_radius else drawn


def touching(start: np.ndarray, diameter: float = 2 * RADIUS) -> str | None:
    """Which pair touches at a start (N, 4) or after the first step, in one line; None if none."""
    heading, speed = start[:, 2], start[:, 3]
    forward = np.column_stack([np.cos(heading), np.sin(heading)])
    then = start[:, :2] + DT * speed[:, None] * forward
    for when, positions in (("at the start", start[:, :2]), ("after the first step", then)):
        gaps = np.linalg.norm(positions[:, None] - positions[None], axis=-1)
        gaps[np.tril_indices(len(start))] = np.inf
        i, j = np.unravel_index(np.argmin(gaps), gaps.shape)
        if gaps[i, j] <= diameter:
            return f"players {i} and {j} touch {when}: {gaps[i, j]:.3f} m apart"
    return None


def scenario(
    start: np.ndarray, weights: np.ndarray | None = None, diameter: float = 2 * RADIUS
) -> Scenario:
    """The scenario of a start (N, 4) and weights (N, 5), equal ones by default."""
    count = len(start)
    return Scenario(
        name="merging",
        game=Game((_player(),) * count, UNICYCLE, HORIZON, DT, _distances(count, diameter)),
        weights=np.ones((count, 5)) if weights is None else weights,
        initial_state=start,
        limits=LIMITS,
    )


def asking_for_the_diameter(known: Scenario, diameter: float) -> Scenario:
    """The scenario of whose diameter estimators are told the prior only."""
    count = known.game.num_players
    asked = replace(known.game, constraints=_distances(count, DIAMETER))
    parameters = np.full((count, 1), np.nan)
    parameters[0] = diameter  # listed with the first player
    return replace(known, asked=asked, parameters=parameters)


def _distances(count: int, diameter: float | Unknown) -> tuple[Distance, ...]:
    """One constraint for each pair of players."""
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count)]
    return tuple(Distance(pair, cast(Any, diameter), first_step=1) for pair in pairs)


def _player() -> Player:
    # Weights sum to one, so each of five equal ones is a fifth of the published one.
    running, final = 5 * RUNNING / 2, 5 * FINAL / 2
    return Player(
        preferences=(
            Tracking("py", LANE, running, final),
            Tracking("heading", HEADING, running, final),
            Tracking("speed", SPEED, running, final),
            ControlEffort("yaw_rate", running / DT**2),
            ControlEffort("acceleration", running / DT**2),
        )
    )

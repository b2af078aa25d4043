"""Drivers on HighwayEnv's roads, and draws of scenarios that the simulator replays exactly."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any, ClassVar, TypeGuard, cast

import numpy as np

from olne_bench.envs.roads.highway_roads import (
    CAR,
    DT,
    MAX_ACCELERATION,
    MAX_SPEED,
    MAX_STEERING,
    replay,
)
from olne_bench.envs.roads.temperaments import (
    checked_shares,
    drawn_temperaments,
    tempered_prior,
    tempered_weights,
)
from olne_bench.envs.scenarios.player_numbers import PlayerNumber, player_number, player_range
from olne_bench.envs.scenarios.scenario import Limits, NoEquilibriumError, Scenario
from olne_bench.envs.scenarios.true_weights import (
    DIRICHLET,
    MODERATE,
    MODERATE_PRIOR,
    TEMPERED,
    check_kind,
    flat_dirichlet,
)
from olne_bench.envs.solved import kept_draws
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.games.model.constraints import Distance
from olne_bench.games.model.costs import CarProximity, ControlEffort, StateDeviation
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.lanes import Lane, LaneKeeping
from olne_bench.games.model.unknowns import Unknown

REPLAY_TOLERANCE = 1e-9  # [m], [rad], [m/s]
MARGIN = 0.25  # [m] on each side of a car, so that small deviations do not cause a collision
HORIZON = 20  # states, hence 7.6 s
WEIGHT_RANGE = (0.2, 1.0)  # of each preference, before scaling to sum one
MAX_DRAWS = 20
#: Controls that the worlds accept, and states that these can reach within the horizon. The game's
#: dynamics have no speed limit, unlike the simulator.
LIMITS = Limits(controls=(MAX_STEERING, MAX_ACCELERATION), states=(2000.0, 2000.0, 400.0, 130.0))
#: Noise of a tracker that sees positions, relative to its position error [m]. Estimated over one
#: second at 10 m/s, headings are wrong by 0.1 rad and speeds by 1 m/s per metre of position error.
NOISE_SCALE = (1.0, 1.0, 0.1, 1.0)


def rejection(scenario: Scenario) -> str | None:
    """Why a draw must not be used: no equilibrium, out of limits or collision; None if it may."""
    if kept_draws.is_held(scenario.game, scenario.weights, scenario.initial_state):
        return None
    reason = _reason(scenario)
    if reason is not None:
        kept_draws.refuse(scenario.game, scenario.weights, scenario.initial_state)
    return reason


def _reason(scenario: Scenario) -> str | None:
    try:
        plan = certified_equilibrium(scenario)
    except NoEquilibriumError:
        return "no equilibrium"
    if (np.abs(plan.controls) > (MAX_STEERING, MAX_ACCELERATION)).any():
        return "out of limits"
    if np.abs(plan.states[..., 3]).max() > MAX_SPEED:
        return "out of limits"
    played = replay(scenario.name, plan.states[0], plan.controls, MARGIN)
    exact = np.abs(played - plan.states).max() < REPLAY_TOLERANCE
    return None if exact else "collision"


@dataclass(frozen=True)
class Manner:
    """Units of the costs on one kind of road, so that weights are comparable.

    Attributes:
        length: unit of distance ahead and behind [m].
        width: unit of distance to the sides [m].
        proximity: scale of the proximity cost.
        speed: deviation from the target speed [m/s] that costs 1.
        acceleration: acceleration [m/s^2] that costs 1.
        steering: steering angle [rad] that costs 1.
        lane: lateral deviation [m] that costs 1.
        heading: heading error [rad] that costs 1.
    """

    length: float
    width: float
    proximity: float
    speed: float
    acceleration: float
    steering: float
    lane: float
    heading: float


#: Units of fast roads: gaps of car lengths, small steering angles.
FAST = Manner(6.0, 2.0, 1.0, speed=3.0, acceleration=2.0, steering=0.03, lane=1.5, heading=0.1)
#: Units in towns: curves of 10 to 25 m radius.
TOWN = Manner(4.0, 3.0, 1.5, speed=2.0, acceleration=2.0, steering=0.2, lane=0.7, heading=0.3)


@dataclass(frozen=True)
class Driver:
    """One drawn car: its start, its route and its target speed.

    Attributes:
        state: (px [m], py [m], heading [rad], speed [m/s]).
        route: lanes to keep.
        target_speed: target speed [m/s].
        blend: length of the passage between lanes of the route [m].
    """

    state: tuple[float, float, float, float]
    route: tuple[Lane, ...]
    target_speed: float
    blend: float = 2.0


def driving_scenario(
    name: str, drivers: list[Driver], manner: Manner, weights: np.ndarray | np.random.Generator
) -> Scenario:
    """A scenario of drivers with the same units; weights (N, 4), or what draws them."""
    if isinstance(weights, np.random.Generator):
        weights = draw_weights(weights, len(drivers))
    players = tuple(_player(driver, manner) for driver in drivers)
    return Scenario(
        name=name,
        game=Game(players, CAR, HORIZON, DT),
        weights=weights,
        initial_state=np.array([driver.state for driver in drivers]),
        limits=LIMITS,
        world="highway_v0",
        noise_scale=NOISE_SCALE,
    )


@dataclass(frozen=True)
class RoadFamily(ABC):
    """A family of draws on one of HighwayEnv's roads; the base class of their scenarios.

    Raises ValueError on a number of players that the road does not hold, a negative distance,
    unknown weights, or shares that are not those of temperaments.

    Attributes:
        name: name of the road, and of the scenario.
        players: fewest and most players that the road holds.
        speeds: least and largest target speed [m/s] on the road, as everybody knows them.
        num_players: N; or ``drawn``, or the fewest and the most, for a number that each seed draws.
        distance: distance [m] that any two cars have to keep, a hard constraint; 0 for none.
        unknown_speeds: whether nobody tells the cars' target speeds to estimators, so that they
            have to find them too.
        weights: ``moderate``, each from 0.2 to 1 before they are scaled; ``dirichlet`` for weights
            that are uniform on the simplex; ``temperaments`` for aggressive, normal and cautious
            drivers (``envs.roads.temperaments``).
        shares: share of each temperament in the traffic; all are equal if None.
    """

    name: ClassVar[str]
    players: ClassVar[tuple[int, int]]
    speeds: ClassVar[tuple[float, float]]
    num_players: PlayerNumber
    distance: float = 0.0
    unknown_speeds: bool = False
    weights: str = MODERATE
    shares: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        player_range(self.name, self.num_players, *self.players)
        check_kind(self.weights, (MODERATE, DIRICHLET, TEMPERED))
        checked_shares(self.shares)
        if self.shares is not None and self.weights != TEMPERED:
            raise ValueError(f"shares need weights = {TEMPERED!r}, got {self.weights!r}")
        if not (isinstance(self.distance, (int, float)) and 0 <= self.distance < np.inf):
            raise ValueError(f"distance must be at least 0 m, got {self.distance!r}")
        if not isinstance(self.unknown_speeds, bool):
            raise ValueError(f"unknown_speeds must be true or false, got {self.unknown_speeds!r}")

    def draw(self, seed: int = 0) -> Scenario:
        """The first playable proposal of a seed; NoEquilibriumError as ``draw_playable``."""
        count = self.count(seed)
        scenario = draw_playable(self.name, partial(self._weighed, seed, count), seed, count)
        return asking_for_speeds(scenario, self.speeds) if self.unknown_speeds else scenario

    def count(self, seed: int) -> int:
        """The number of players of a seed."""
        return player_number(player_range(self.name, self.num_players, *self.players), seed)

    def temperaments(self, seed: int) -> tuple[str, ...]:
        """The temperament of each player of a seed; none with other weights."""
        if self.weights != TEMPERED:
            return ()
        return drawn_temperaments(seed, self.count(seed), checked_shares(self.shares))

    def tempered(self, seed: int) -> np.ndarray:
        """The true weights (N, 4) of a seed whose players have temperaments."""
        return tempered_weights(seed, self.temperaments(seed))

    def _weighed(self, seed: int, count: int, rng: np.random.Generator) -> Scenario:
        """One proposal with its constraints and its weights."""
        scenario = self.constrained(rng, count)
        if self.weights == TEMPERED:
            prior = tempered_prior(checked_shares(self.shares))
            return replace(scenario, weights=self.tempered(seed), prior=prior)
        if self.weights == DIRICHLET:
            return replace(scenario, weights=flat_dirichlet(seed, *scenario.weights.shape))
        return replace(scenario, prior=MODERATE_PRIOR)

    def constrained(self, rng: np.random.Generator, count: int) -> Scenario:
        """One proposal with its constraints."""
        scenario = self.propose(rng, count)
        if not self.distance:
            return scenario
        pairs = combinations(range(count), 2)
        constraints = tuple(Distance(pair, float(self.distance)) for pair in pairs)
        return replace(scenario, game=replace(scenario.game, constraints=constraints))

    @staticmethod
    @abstractmethod
    def propose(rng: np.random.Generator, count: int) -> Scenario:
        """One draw of so many players, which may be unplayable."""


def asking_for_speeds(scenario: Scenario, speeds: tuple[float, float]) -> Scenario:
    """The scenario, the target speed of each player unknown (``unknown_speed``)."""
    players, unknown = scenario.game.players, unknown_speed(speeds)
    asked = replace(scenario.game, players=tuple(with_target(one, unknown) for one in players))
    targets = np.array([[speed_feature(player).target] for player in players])
    return replace(scenario, asked=asked, parameters=targets)


def unknown_speed(speeds: tuple[float, float]) -> Unknown:
    """A target speed that estimators have to find.

    Its prior has the mean and deviation of a uniform distribution over ``speeds``, and a range
    twice as wide.
    """
    low, high = speeds
    mean, width = (low + high) / 2, high - low
    deviation = width / float(np.sqrt(12))
    return Unknown("target speed", "m/s", mean - width, mean + width, mean, deviation)


def speed_feature(player: Player) -> StateDeviation:
    """What the player pays for deviations from its target speed."""
    (feature,) = (one for one in player.preferences if _is_speed(one))
    return feature


def with_target(player: Player, target: float | Unknown) -> Player:
    """The player with another target speed, which may be unknown."""
    preferences = tuple(
        replace(feature, target=cast(Any, target)) if _is_speed(feature) else feature
        for feature in player.preferences
    )
    return replace(player, preferences=preferences)


def _is_speed(feature: object) -> TypeGuard[StateDeviation]:
    return isinstance(feature, StateDeviation) and feature.component == "speed"


def draw_playable(
    name: str, draw: Callable[[np.random.Generator], Scenario], seed: int, num_players: int
) -> Scenario:
    """The first draw with a certified equilibrium that the simulator plays exactly.

    HighwayEnv looks one frame ahead for collisions and pushes cars apart. A draw is rejected if
    this would change the plan of cars that are a little wider. A draw's seed is derived from
    ``seed``, the number of players and its own number. Raises NoEquilibriumError if ``MAX_DRAWS``
    draws are rejected.
    """
    for attempt in range(MAX_DRAWS):
        scenario = draw(np.random.default_rng([seed, num_players, attempt]))
        if rejection(scenario) is None:
            return scenario
    raise NoEquilibriumError(
        f"no playable draw of {name!r} in {MAX_DRAWS} from seed {seed} with {num_players} players"
    )


def draw_weights(rng: np.random.Generator, count: int) -> np.ndarray:
    """Weights (N, 4), each drawn from ``WEIGHT_RANGE``."""
    return rng.uniform(*WEIGHT_RANGE, (count, 4))


def _player(driver: Driver, manner: Manner) -> Player:
    return Player(
        preferences=(
            CarProximity(manner.length, manner.width, scale=manner.proximity),
            StateDeviation("speed", target=driver.target_speed, scale=manner.speed**-2),
            ControlEffort("acceleration", scale=(DT * manner.acceleration) ** -2),
            ControlEffort("steering", scale=(DT * manner.steering) ** -2),
        ),
        task=(
            LaneKeeping(
                driver.route,
                width=manner.lane,
                heading_scale=manner.heading**-2,
                blend=driver.blend,
            ),
        ),
    )

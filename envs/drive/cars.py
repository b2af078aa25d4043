"""Cars of a drive that goes on, drawn from the proposals of a road's family; costs of the ego.

A drive takes smaller steps than a scenario: three of the simulator's frames. Its costs are the
scenario's per second.

The ego pays by its own true features and weights (``EgoCost``). Proximity is counted from where a
car is ``RANGE`` lengths ahead, so that it does not matter how many are far away. The unit is what a
step costs an ego that stands at its start, alone. After a collision each step costs one, and no
step costs more, so that drives count alike whatever the weights and the road.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.roads.footprint import gap
from olne_bench.envs.roads.highway_roads import DT, SIMULATION_FREQUENCY
from olne_bench.envs.roads.road_scenario import RoadFamily, speed_feature
from olne_bench.envs.roads.temperaments import TEMPERAMENTS, checked_shares, tempered_prior
from olne_bench.envs.scenarios import highway, intersection, merge, roundabout, two_way
from olne_bench.envs.scenarios.true_weights import DIRICHLET, TEMPERED
from olne_bench.games.model.constraints import Constraint
from olne_bench.games.model.costs import CarProximity, ControlEffort, Feature, Stage
from olne_bench.games.model.dynamics import bicycle
from olne_bench.games.model.game import Game, Player
from olne_bench.games.model.lanes import Lane, LaneKeeping
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

FRAMES = 3  # of the simulator in a step
STEP = FRAMES / SIMULATION_FREQUENCY  # [s], 0.2
DURATION = 20.0  # [s]
STEPS = round(DURATION / STEP)

#: HighwayEnv's vehicle in a step.
MOTION = bicycle(rear_axle=Vehicle.LENGTH / 2, sub_steps=FRAMES)

#: Cars keep out of each other from this step of a plan on, as controls change little of what is
#: nearer in time.
FIRST_STEP = 2

#: Routes are tables of so many lanes, so that many games share one solver: those of roads that go
#: on, and those of towns.
_FEW_LANES, _MANY_LANES = 2, 5

#: How hidden weights are drawn.
WEIGHTS = (TEMPERED, DIRICHLET)
#: Lengths ahead, or widths beside, from which on another car counts as nothing.
RANGE = 5.0


@dataclass(frozen=True)
class DriveRoad:
    """What a drive takes from a family, and where its cars come and go; distances in [m].

    Cars leave so far ahead of the ego or behind it. Where the road does not go on, ``ahead`` is
    that from its middle, at which cars on the last lane of their route leave.
    """

    family: type[RoadFamily]  # draws starts, routes, target speeds; everybody knows its speeds
    cars: int  # number of cars, the ego included
    ego: int  # which car of a proposal the ego is
    lead: float  # by which the ego starts farther back than proposed
    moving: bool  # whether starts of cars with one lane move along, as the road goes on
    shift: float  # by which these starts are moved ahead or back, so that there is room
    entry: float  # least distance from the ego at which cars enter
    ahead: float
    behind: float


ROADS: dict[str, DriveRoad] = {
    "highway": DriveRoad(highway.Highway, 5, 1, 0.0, True, 0.0, 40.0, 150.0, 70.0),
    "merge": DriveRoad(merge.Merge, 5, 0, 0.0, True, 60.0, 40.0, 150.0, 70.0),
    "two_way": DriveRoad(two_way.TwoWay, 5, 0, 0.0, True, 0.0, 60.0, 360.0, 70.0),
    "roundabout": DriveRoad(roundabout.Roundabout, 4, 1, 20.0, False, 0.0, 20.0, 60.0, 0.0),
    "intersection": DriveRoad(intersection.Intersection, 4, 0, 25.0, False, 0.0, 20.0, 60.0, 0.0),
}


@dataclass(frozen=True)
class Car:
    """One car of a drive."""

    number: int  # identifies it; no number is used twice
    player: Player  # its features, for steps of a drive
    weights: np.ndarray  # (4,) of its preferences, sum one
    lanes: tuple[Lane, ...]  # its route
    start: np.ndarray  # (4,) px [m], py [m], heading [rad], speed [m/s]

    @property
    def target_speed(self) -> float:
        """[m/s]."""
        return float(speed_feature(self.player).target)


@dataclass(frozen=True)
class Mind:
    """A car as the ego takes it to be."""

    number: int  # identifies the car
    player: Player  # its features, with a target speed
    weights: np.ndarray  # (4,) of its preferences


def proposed_cars(road: DriveRoad, rng: np.random.Generator, kind: str) -> list[Car]:
    """The cars of one proposal, the ego first; numbers are their places.

    ``rng`` draws the proposal, then the weights, whose kind is one of ``WEIGHTS``.
    """
    scenario = road.family.propose(rng, road.cars)
    order = [road.ego, *(i for i in range(road.cars) if i != road.ego)]
    cars = []
    for number, index in enumerate(order):
        player = scenario.game.players[index]
        (keeping,) = player.task
        assert isinstance(keeping, LaneKeeping)
        start = scenario.initial_state[index].astype(float)
        if number == 0:
            start[:2] -= road.lead * np.array([np.cos(start[2]), np.sin(start[2])])
        cars.append(Car(number, at_step(player), drawn_weights(rng, kind), keeping.route, start))
    return cars


def drawn_weights(rng: np.random.Generator, kind: str) -> np.ndarray:
    """Hidden weights (4,) of one car."""
    if kind == DIRICHLET:
        return rng.dirichlet(np.ones(4))
    return rng.dirichlet(TEMPERAMENTS[str(rng.choice(list(TEMPERAMENTS)))])


def prior_of(kind: str) -> WeightPrior:
    """What is known of hidden weights of this kind."""
    return FLAT if kind == DIRICHLET else tempered_prior(checked_shares(None))


def at_step(player: Player) -> Player:
    """A player of a family in the steps of a drive, with the same costs per second."""
    preferences = tuple(
        replace(feature, scale=feature.scale * (DT / STEP) ** 2)
        if isinstance(feature, ControlEffort)
        else feature
        for feature in player.preferences
    )
    (keeping,) = player.task
    assert isinstance(keeping, LaneKeeping)
    return Player(
        preferences, (keeping.resized(_FEW_LANES if keeping.size <= _FEW_LANES else _MANY_LANES),)
    )


def drive_game(
    players: Sequence[Player], horizon: int, constraints: tuple[Constraint, ...] = ()
) -> Game:
    """The game of players over so many states."""
    return Game(tuple(players), MOTION, horizon, STEP, constraints)


def middle_speed(road: DriveRoad) -> float:
    """The middle of the target speeds [m/s] on a road."""
    return float(np.mean(road.family.speeds))


class EgoCost:
    """The cost of the steps of an ego."""

    def __init__(self, ego: Car) -> None:
        (near,) = (one for one in ego.player.preferences if isinstance(one, CarProximity))
        self._weights, self._near = ego.weights, near
        self._proximity = _function(near, players=2)
        self._own = [
            None if feature is near else _function(feature, players=1)
            for feature in ego.player.features
        ]
        stands = ego.start.copy()
        stands[3] = 0.0
        self._standing = self.of_step(stands[None], np.zeros(2))

    def of_step(self, states: np.ndarray, control: np.ndarray) -> float:
        """Cost of a step from states (N, 4), the ego first, with the ego's control (2,)."""
        return float(self._of_steps(states[None], control[None])[0])

    def share(self, states: np.ndarray, control: np.ndarray) -> float:
        """Cost of a step as a share of that of standing at the start, at most 1."""
        return min(self.of_step(states, control) / self._standing, 1.0)

    def shares(self, motion: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """Costs (T,) of steps as shares of that of standing at the start, at most 1.

        From states (T, N, 4), the ego first, with the ego's controls (T, 2).
        """
        return np.minimum(self._of_steps(motion, controls) / self._standing, 1.0)

    def of_plans(self, motions: np.ndarray, controls: np.ndarray, room: float = 0.0) -> np.ndarray:
        """Mean shares (...) of the steps of plans: motions (..., T+1, N, 4), controls (..., T, 2).

        Steps after the first in which the ego overlaps another car cost one each. Where it comes
        nearer than ``room`` [m], they do so with a chance that grows to one.
        """
        lead, (steps, size) = controls.shape[:-2], controls.shape[-2:]
        states = motions[..., :-1, :, :].reshape(-1, *motions.shape[-2:])
        shares = self.shares(states, controls.reshape(-1, size)).reshape(*lead, steps)
        nearest = np.minimum.accumulate(least_gaps(motions), axis=-1)
        hit = np.where(nearest <= 0, 1.0, np.clip(1 - nearest / room, 0, 1) if room else 0.0)
        after = np.concatenate([np.zeros((*lead, 1)), hit[..., :-1]], axis=-1)
        return np.asarray((after + (1 - after) * shares).mean(axis=-1))

    def of_drive(
        self,
        motion: Sequence[np.ndarray],
        controls: Sequence[np.ndarray],
        crashed: bool,
        steps: int = STEPS,
    ) -> float:
        """Mean share of the steps of a whole drive, 0 to 1, which may have ended in a collision.

        The motion is the states (N, 4) at each step, the ego first, and those at the end.
        """
        costs = [
            self.share(states, control)
            for states, control in zip(motion[:-1], controls, strict=True)
        ]
        if crashed:
            costs += [1.0] * (steps - len(costs))
        return float(np.mean(costs))

    def _of_steps(self, motion: np.ndarray, controls: np.ndarray) -> np.ndarray:
        ego = np.ascontiguousarray(motion[:, 0].T)
        values = [
            self._proximities(motion) if one is None else one(ego, controls.T).full()[0]
            for one in self._own
        ]
        count = len(self._weights)
        task = np.sum(values[count:], axis=0) * self._weights.mean()
        return np.asarray(self._weights @ np.array(values[:count]) + task)

    def _proximities(self, motion: np.ndarray) -> np.ndarray:
        """Of each step (T,), by all others that are near."""
        far = -self._near.scale * np.log(RANGE**2 + self._near.offset)
        steps, nearby = len(motion), np.zeros(len(motion))
        for other in range(1, motion.shape[1]):
            pairs = np.ascontiguousarray(motion[:, (0, other)].reshape(2 * steps, -1).T)
            found = self._proximity(pairs, np.zeros((2, steps))).full()[0]
            nearby += np.maximum(found - far, 0.0)
        return nearby


def least_gaps(motion: np.ndarray) -> np.ndarray:
    """Least gaps (..., T) [m] of the ego to others in each step of a motion (..., T+1, N, 4).

    They are looked at in each of the simulator's frames: cars that cross are nearest between two
    steps.
    """
    before, after = motion[..., :-1, :, :], motion[..., 1:, :, :]
    frames = np.stack([before + k / FRAMES * (after - before) for k in range(1, FRAMES + 1)])
    found = gap(frames[..., :1, :], frames[..., 1:, :])
    return np.asarray(found.min(axis=(0, -1), initial=np.inf))


def _function(feature: Feature, players: int) -> ca.Function:
    """``(states (4, players), control (2,)) -> running cost`` of player 0."""
    states = ca.SX.sym("states", MOTION.state_size, players)
    control = ca.SX.sym("control", MOTION.control_size)
    stage = Stage(0, tuple(ca.horzsplit(states)), control, MOTION, STEP)
    return ca.Function("cost", [states, control], [ca.SX(feature.running_cost(stage))])

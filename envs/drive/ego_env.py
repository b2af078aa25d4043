"""The ego of a drive as an environment of Gymnasium, for drivers that learn.

What they see is in the ego's frame and about of size one, so that one driver can learn all roads.
"""

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import gymnasium
import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.drive.cars import ROADS, STEPS, Car, EgoCost
from olne_bench.envs.drive.setting import TRAFFIC, DriveSetting
from olne_bench.envs.drive.starts import NoDriveError
from olne_bench.envs.drive.world import NEAREST, DriveWorld, seen
from olne_bench.envs.roads.highway_roads import MAX_ACCELERATION, MAX_STEERING
from olne_bench.games.model.lanes import ArcLane, SineLane, StraightLane

#: Distances [m] along the route at which the ego looks ahead.
_AHEAD = (0.0, 5.0, 10.0, 20.0, 40.0)
_SPACING = 1.0  # of points of a route [m]
_FURTHER = 200.0  # of straight lanes at the ends of a route [m]
_LENGTH, _SPEED = 20.0, 10.0  # units [m], [m/s]
LARGEST = 5.0
_OF_OTHER = 7

#: Size of what a driver sees: its route, its speed and aims, its weights, and the others.
SIZE = 2 * len(_AHEAD) + 3 + 4 + _OF_OTHER * NEAREST

#: What it does is added to following the route at constant speed: at most so much steering [rad]
#: and acceleration [m/s^2].
STEERING, ACCELERATION = 0.06, 5.0
_LOOK_AHEAD = 0.8  # [s]
_LEAST_LOOK_AHEAD = 6.0  # [m]
#: Seeds of these drives start here: those of studies are smaller.
FIRST_SEED = 10_000_000


class EgoView:
    """The view of one ego."""

    def __init__(self, ego: Car) -> None:
        self._ego = ego
        self._route = _points(ego.lanes)

    def of(self, samples: np.ndarray) -> np.ndarray:
        """What the driver sees (SIZE,) of samples (1 + M, 4) of the ego and the others."""
        (px, py, heading, speed), target = samples[0], self._ego.target_speed
        turn = _turn(heading)
        here = np.array([px, py])
        route = (self._from(here, _AHEAD) - here) @ turn / _LENGTH
        aims = [speed / _SPEED, target / _SPEED, (target - speed) / _SPEED]
        own = [route.ravel(), aims, self._ego.weights]
        found = np.concatenate([*own, self._others(samples, turn)])
        return found.clip(-LARGEST, LARGEST).astype(np.float32)

    def control(self, state: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Steering [rad] and acceleration [m/s^2] (2,) for an action (2,) within -1 and 1.

        Without an action the ego follows its route at constant speed: it steers along the arc to a
        point of the route ahead (pure pursuit, Coulter 1992).
        """
        px, py, heading, speed = state
        away = max(_LEAST_LOOK_AHEAD, _LOOK_AHEAD * speed)
        ahead, beside = (self._from(np.array([px, py]), (away,))[0] - [px, py]) @ _turn(heading)
        distance = max(np.hypot(ahead, beside), 1.0)
        steering = np.arctan(2 * Vehicle.LENGTH * (beside / distance) / distance)
        bent, pushed = np.clip(action, -1.0, 1.0)
        control = np.array([steering + STEERING * bent, ACCELERATION * pushed])
        largest = np.array([MAX_STEERING, MAX_ACCELERATION])
        return np.asarray(np.clip(control, -largest, largest))

    def _from(self, here: np.ndarray, distances: Sequence[float]) -> np.ndarray:
        """Points (D, 2) of the route so far [m] ahead of the one that is nearest."""
        nearest = int(np.argmin(((self._route - here) ** 2).sum(axis=1)))
        places = [min(nearest + round(d / _SPACING), len(self._route) - 1) for d in distances]
        return self._route[places]

    def _others(self, samples: np.ndarray, turn: np.ndarray) -> np.ndarray:
        """The nearest others first: presence, position, velocity, direction; zeros for nobody."""
        found = np.zeros((NEAREST, _OF_OTHER))
        own = samples[0]
        away = np.hypot(*(samples[1:, :2] - own[:2]).T)
        for slot, index in zip(found, np.argsort(away, kind="stable"), strict=False):
            other = samples[1 + index]
            heading = other[2] - own[2]
            slot[0] = 1.0
            slot[1:3] = (other[:2] - own[:2]) @ turn / _LENGTH
            slot[3:5] = np.array([np.cos(heading), np.sin(heading)]) * other[3] / _SPEED
            slot[3] -= own[3] / _SPEED
            slot[5:7] = np.cos(heading), np.sin(heading)
        return found.ravel()


def _turn(heading: float) -> np.ndarray:
    """Matrix (2, 2) by which rows are turned into the frame of a heading [rad]."""
    cos, sin = np.cos(heading), np.sin(heading)
    return np.array([[cos, -sin], [sin, cos]])


def _points(lanes: Sequence[object]) -> np.ndarray:
    """Points (P, 2) of a route; its first and last lanes go on where they are straight."""
    found = []
    for number, lane in enumerate(lanes):
        assert isinstance(lane, StraightLane | SineLane | ArcLane)
        curve, straight = lane.general(), isinstance(lane, StraightLane)
        first = -_FURTHER if straight and number == 0 else 0.0
        last = lane.length + (_FURTHER if straight and number == len(lanes) - 1 else 0.0)
        found += [curve.point(along) for along in np.arange(first, last, _SPACING)]
    return np.array(found)


class EgoEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A drive of 20 s on a road, in traffic, which are both drawn unless they are named.

    The observation (SIZE,) is ``EgoView.of`` noisy samples; the action (2,) is added to following
    the route (``EgoView.control``). A step is rewarded with less than nothing: with what it costs
    the ego, as a share of what it costs to stand at the start, at most one. A collision ends the
    episode and costs one for each step that is left.
    """

    def __init__(
        self, road: str | None = None, traffic: str | None = None, sigma: float = 0.1
    ) -> None:
        """Road and traffic are drawn for each episode if None; ``sigma`` [m] is the noise level."""
        for what, given, known in (("road", road, tuple(ROADS)), ("traffic", traffic, TRAFFIC)):
            if given is not None and given not in known:
                raise ValueError(f"unknown {what} {given!r}; known are: {', '.join(known)}")
        self._roads = tuple(ROADS) if road is None else (road,)
        self._traffic = TRAFFIC if traffic is None else (traffic,)
        self._sigma = sigma
        self.observation_space = gymnasium.spaces.Box(-LARGEST, LARGEST, (SIZE,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        self._world = self._drawn()
        ego = self._world.cars[0]
        self._view, self._cost = EgoView(ego), EgoCost(ego)
        return self._observed(), {"crashed": False}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        before = self._world.states()
        control = self._view.control(before[0], np.asarray(action, dtype=float))
        self._world.advance(control)
        reward = -self._cost.share(before, control)
        crashed = self._world.crashed
        if crashed:
            reward -= STEPS - self._world.step
        truncated = self._world.over and not crashed
        return self._observed(), reward, crashed, truncated, {"crashed": crashed}

    def _drawn(self) -> DriveWorld:
        """A drive that can be driven."""
        while True:
            road = str(self.np_random.choice(self._roads))
            traffic = str(self.np_random.choice(self._traffic))
            number = FIRST_SEED + int(self.np_random.integers(10**8))
            with suppress(NoDriveError):
                return DriveWorld(DriveSetting(road, traffic), number)

    def _observed(self) -> np.ndarray:
        rng = self.np_random
        _, samples = seen(self._world, self._sigma, lambda _: rng)
        return self._view.of(samples)

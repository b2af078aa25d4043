"""Lanes of recorded cars at one moment: where a car goes on to, and whom it follows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from olne_bench.envs.tracks.grid import Grid, Motion
from olne_bench.envs.tracks.road import Place, Road, locate
from olne_bench.envs.tracks.table import STATE_NAMES

#: A car is in a lane up to this distance beside its centre line [m].
BESIDE = 2.2
#: Leaders are looked for so far ahead [m].
REACH = 80.0
#: Two centres of cars on one way are at least so far apart [m].
_BUMPER = 0.5
#: Cosine of the largest angle between a car and its lane.
_ALONG = 0.7
#: Lanes are followed so far past a car [m].
_ONWARD = 250.0
#: Points of a lane closer to each other than this are one [m].
_APART = 1e-3


@dataclass(frozen=True)
class Standing:
    """A car at one moment."""

    position: np.ndarray  # (2,) [m]
    heading: float  # [rad]
    speed: float  # [m/s]


def standing(motion: Motion, at: int) -> Standing | None:
    """A car at a sample; None where it is not seen."""
    heading, speed = motion.headings[: at + 1], motion.speeds[at]
    told = heading[np.isfinite(heading)]
    if not motion.seen[at] or not told.size or not np.isfinite(speed):
        return None
    return Standing(motion.positions[at], float(told[-1]), float(abs(speed)))


def motions_of(grid: Grid) -> list[Motion]:
    """The motion of each player."""
    names = list(STATE_NAMES.values())
    return [Motion.of(grid.states[:, i], names, grid.step) for i in range(len(grid.players))]


def standing_cars(
    players: Sequence[str], motions: Sequence[Motion], at: int
) -> dict[str, Standing]:
    """The cars that are seen at a sample, by their names."""
    found = ((name, standing(own, at)) for name, own in zip(players, motions, strict=True))
    return {name: car for name, car in found if car is not None}


class Scene:
    """All cars of a road at one moment."""

    def __init__(self, road: Road, cars: Mapping[str, Standing]) -> None:
        """Cars by their names."""
        self.road, self.cars = road, dict(cars)
        self._positions = np.array([car.position for car in cars.values()]).reshape(-1, 2)
        self._headings = np.array([car.heading for car in cars.values()])
        self._lanes: dict[str, str | None] = {}

    def lane(self, name: str) -> str | None:
        """The nearest lane that a car is in and drives along; None if there is none."""
        if name not in self._lanes:
            car, found = self.cars[name], []
            for lane, shape in self.road.lanes.items():
                place = locate(shape.line, car.position[None])
                if _inside(place, car.heading)[0]:
                    found.append((float(place.distance[0]), lane))
            self._lanes[name] = min(found)[1] if found else None
        return self._lanes[name]

    def leader(self, follower: str) -> str | None:
        """Who drives next ahead of a car on its way on, within ``REACH``; None if nobody does."""
        lane = self.lane(follower)
        if lane is None:
            return None
        place, names = locate(way_on(self.road, lane), self._positions), list(self.cars)
        ahead = place.along - place.along[names.index(follower)]
        ahead[~_inside(place, self._headings) | (ahead < _BUMPER)] = np.inf
        nearest = int(ahead.argmin())
        return names[nearest] if ahead[nearest] < REACH else None

    def chain(self, follower: str, most: int) -> list[str]:
        """A car, its leader, the leader's leader and so on, ``most`` at most."""
        chain = [follower]
        while len(chain) < most:
            leader = self.leader(chain[-1])
            if leader is None or leader in chain:
                break
            chain.append(leader)
        return chain


def _inside(place: Place, headings: np.ndarray | float) -> np.ndarray:
    """Which cars (S,) of these headings are on a line and drive along it."""
    return (place.distance < BESIDE) & (np.cos(place.heading - headings) > _ALONG)


def folded(angle: float) -> float:
    """An angle between -pi and pi [rad]."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def way_on(road: Road, lane: str) -> np.ndarray:
    """Points (P, 2) of a lane and of those that follow it, the straightest where there are more."""
    line, passed = road.lanes[lane].line, {lane}
    enough = _length(line) + _ONWARD
    while _length(line) < enough:
        following = [n for n in road.lanes[lane].following if n in road.lanes and n not in passed]
        if not following:
            break
        lane = min(following, key=lambda name: _turn(line, road.lanes[name].line))
        passed.add(lane)
        line = np.vstack([line, road.lanes[lane].line])
    apart = np.linalg.norm(np.diff(line, axis=0), axis=1) > _APART
    return np.asarray(line[np.concatenate([[True], apart])])


def _length(line: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _turn(line: np.ndarray, following: np.ndarray) -> float:
    """Angle [rad] between the end of a line and the first part of a following one, as a whole."""
    ends = line[-1] - line[-2], following[-1] - following[0]
    before, after = (np.arctan2(y, x) for x, y in ends)
    return abs(folded(after - before))

"""Lanes beside recorded cars, and who drives there."""

from dataclasses import dataclass

import numpy as np

from olne_bench.envs.tracks.leaders import BESIDE, REACH, Scene, folded, way_on
from olne_bench.envs.tracks.prediction import places
from olne_bench.envs.tracks.road import locate

#: The centre of a lane beside a car's own is so far from it [m].
_NEXT = (BESIDE, 5.5)
#: A lane beside goes the same way up to this angle [rad], and the car is past its end by less [m].
_SAME, _PAST = 0.3, 0.5


@dataclass(frozen=True)
class Neighbour:
    """A car ahead or behind in a lane: distance of centres [m], speed [m/s]."""

    gap: float
    speed: float


@dataclass(frozen=True)
class Beside:
    """A lane beside a car's own at its moment."""

    left: float  # [m] to its centre, negative to the right
    ahead: Neighbour | None
    behind: Neighbour | None


def lanes_beside(scene: Scene, name: str) -> tuple[Beside, ...]:
    """The nearest lane to the right and to the left of a car, where there are such."""
    car, found = scene.cars[name], dict[bool, tuple[float, str]]()
    for lane, shape in scene.road.lanes.items():
        place = locate(shape.line, car.position[None])
        left = -float(places(shape.line, car.position[None])[0, 1])
        off, turn = float(place.distance[0]), folded(float(place.heading[0]) - car.heading)
        is_next = _NEXT[0] < off < _NEXT[1] and off < abs(left) + _PAST
        if is_next and abs(turn) < _SAME and lane != scene.lane(name):
            found[left > 0] = min(found.get(left > 0, (np.inf, "")), (abs(left), lane))
    return tuple(
        _beside(scene, name, distance if is_left else -distance, lane)
        for is_left, (distance, lane) in sorted(found.items())
    )


def _beside(scene: Scene, name: str, left: float, lane: str) -> Beside:
    """Who drives in a lane, and in one that leads to it."""
    names, cars = [*scene.cars], [*scene.cars.values()]
    before = [shape.line[:-1] for shape in scene.road.lanes.values() if lane in shape.following]
    way = np.vstack([*before[:1], way_on(scene.road, lane)])
    place = locate(way, np.array([car.position for car in cars]))
    gaps = place.along - place.along[names.index(name)]
    there = {
        float(gap): car.speed
        for gap, car, distance, who in zip(gaps, cars, place.distance, names, strict=True)
        if who != name and distance < BESIDE and abs(gap) < REACH
    }
    ahead = min((gap for gap in there if gap >= 0), default=None)
    behind = max((gap for gap in there if gap < 0), default=None)
    return Beside(
        left,
        None if ahead is None else Neighbour(ahead, there[ahead]),
        None if behind is None else Neighbour(-behind, there[behind]),
    )

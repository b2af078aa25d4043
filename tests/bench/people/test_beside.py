"""Lanes beside a car."""

import numpy as np
import pytest

from olne_bench.bench.people.beside import Neighbour, lanes_beside
from olne_bench.envs.tracks.leaders import Scene, Standing
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.games.model.lanes import StraightLane


def lane(x: float, y: float, length: float, *following: str, turned: bool = False) -> RoadLane:
    direction = (-1.0, 0.0) if turned else (1.0, 0.0)
    return RoadLane((StraightLane((x, y), direction, length),), following=following)


def car(x: float, y: float, speed: float = 10.0) -> Standing:
    return Standing(np.array([x, y]), 0.0, speed)


ROAD = Road(
    {
        "own": lane(0, 0, 200),
        "before": lane(-100, 3.5, 100, "left"),
        "left": lane(0, 3.5, 200),
        "oncoming": lane(200, -3.5, 200, turned=True),
        "far": lane(0, 7.0, 200),
        "past": lane(0, -3.4, 10),
    }
)


def test_the_lane_beside_has_those_ahead_and_behind():
    cars = {
        "me": car(20, 0.3),
        "ahead": car(45, 3.4, 12.0),
        "farther": car(60, 3.5),
        "behind": car(-5, 3.6, 14.0),  # in the lane before
        "in my lane": car(30, 0.0),
    }
    (found,) = lanes_beside(Scene(ROAD, cars), "me")
    assert found.left == pytest.approx(3.2)
    assert found.ahead == Neighbour(pytest.approx(25), 12.0)
    assert found.behind == Neighbour(pytest.approx(25), 14.0)


def test_an_empty_lane_has_nobody_and_the_last_has_one_side():
    (found,) = lanes_beside(Scene(ROAD, {"me": car(20, 7.0)}), "me")
    assert (found.ahead, found.behind) == (None, None)
    assert found.left == pytest.approx(-3.5)

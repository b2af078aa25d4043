"""Who is in which lane, and who follows whom."""

import numpy as np
import pytest

from olne_bench.envs.tracks.leaders import Scene, Standing, way_on
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.games.model.lanes import StraightLane

EAST, NORTH = (1.0, 0.0), (0.0, 1.0)


def lane(start: tuple[float, float], way: tuple[float, float], length: float, *ahead: str):
    return RoadLane((StraightLane(start, way, length),), following=ahead)


ROAD = Road(
    {
        "left": lane((0, 4), EAST, 100),
        "right": lane((0, 0), EAST, 100, "turn", "on"),
        "on": lane((100, 0), EAST, 400),
        "turn": lane((100, 0), NORTH, 50),
        "oncoming": lane((100, 4), (-1.0, 0.0), 100),
    }
)


def car(x: float, y: float = 0.0, heading: float = 0.0) -> Standing:
    return Standing(np.array([x, y]), heading, 10.0)


CARS = {
    "a": car(10),
    "b": car(30, 0.5),
    "beside": car(20, 4),
    "far": car(105),
    "against": car(50, 4, np.pi),
    "turned": car(100, 20, np.pi / 2),
    "off": car(20, 40),
}


def test_a_car_is_in_the_nearest_lane_that_it_drives_along() -> None:
    scene = Scene(ROAD, CARS)
    found = {name: scene.lane(name) for name in CARS}
    assert found == {
        "a": "right",
        "b": "right",
        "beside": "left",
        "far": "on",
        "against": "oncoming",
        "turned": "turn",
        "off": None,
    }


def test_the_leader_is_the_next_car_on_the_way_on() -> None:
    scene = Scene(ROAD, CARS)
    assert scene.leader("a") == "b"
    assert scene.leader("b") == "far"  # the straighter way, 75 m on
    assert [scene.leader(name) for name in ("far", "beside", "off", "turned")] == [None] * 4
    assert scene.chain("a", 5) == ["a", "b", "far"]
    assert scene.chain("a", 2) == ["a", "b"]


def test_leaders_are_near() -> None:
    for x, leader in ((89, "b"), (91, None)):
        assert Scene(ROAD, {"a": car(10), "b": car(x)}).leader("a") == leader


def test_a_way_goes_straight_on_and_has_no_point_twice() -> None:
    line = way_on(ROAD, "right")
    assert line[-1] == pytest.approx([500, 0])
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).min() > 0.001


def test_a_ring_ends() -> None:
    ring = Road({"one": lane((0, 0), EAST, 10, "two"), "two": lane((10, 0), EAST, 10, "one")})
    assert way_on(ring, "one")[-1] == pytest.approx([20, 0])

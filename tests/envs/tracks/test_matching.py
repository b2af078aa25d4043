"""Matching of cars to lanes by position and heading."""

import numpy as np
import pytest

from olne_bench.envs.tracks.matching import driven, route
from olne_bench.envs.tracks.motion import Motion, roughness
from olne_bench.envs.tracks.of_scenario import highway_road
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.games.lanes import StraightLane

EAST, NORTH = (1.0, 0.0), (0.0, 1.0)


def straight(start: tuple[float, float], way: tuple[float, float], length: float, *ahead: str):
    return RoadLane((StraightLane(start, way, length),), following=ahead)


#: Two lanes side by side, one in the opposite direction over the first, and a branch.
ROAD = Road(
    {
        "left": straight((0, 4), EAST, 100),
        "right": straight((0, 0), EAST, 100, "off"),
        "oncoming": straight((100, 4), (-1.0, 0.0), 100),
        "off": straight((100, 0), NORTH, 50),
    }
)


def motion(points: np.ndarray, dt: float = 0.5) -> Motion:
    states = np.full((len(points), 4), np.nan)
    states[:, :2] = points
    return Motion.of(states, ["px", "py", "heading", "speed"], dt)


def along(x: np.ndarray, y: np.ndarray | float) -> np.ndarray:
    return np.column_stack([x, np.broadcast_to(y, x.shape)])


X = np.linspace(5, 90, 18)


def names(points: np.ndarray) -> list[str]:
    return route(ROAD, driven(ROAD, motion(points)))[1]


def test_heading_tells_lanes_at_one_place_apart() -> None:
    assert names(along(X, 4.2)) == ["left"]
    assert names(along(X[::-1], 4.2)) == ["oncoming"]


def test_a_lane_change_leads_to_the_new_lane() -> None:
    assert names(along(X, np.linspace(0, 4, len(X)))) == ["left"]


def test_noise_is_no_lane_change() -> None:
    noise = np.random.default_rng(0).normal(0, 0.8, len(X))
    assert names(along(X, noise)) == ["right"]


def test_who_comes_back_keeps_the_other_lane_until_then() -> None:
    y = 4 * np.exp(-(((X - 45) / 18) ** 6))
    curves, lanes = route(ROAD, driven(ROAD, motion(along(X, y))))
    assert lanes == ["left", "right"]
    assert 55 < curves[0].length < 75 and curves[1].length == 100


def test_a_turn_follows_the_road() -> None:
    up = np.linspace(3, 40, 9)
    points = np.vstack([along(X, 0.0), np.column_stack([np.full(9, 100.0), up])])
    assert names(points) == ["right", "off"]


def test_lanes_between_two_samples_are_on_the_route() -> None:
    lanes = {f"l{k}": straight((5.0 * k, 0), EAST, 5, f"l{k + 1}") for k in range(8)}
    road = Road(lanes | {"l8": straight((40.0, 0), EAST, 5)})
    curves, passed = route(road, driven(road, motion(along(np.array([1.0, 16.0, 31.0, 44.0]), 0))))
    assert passed == [f"l{k}" for k in range(9)]
    (joined,) = curves  # straight lanes that go on are one
    assert joined.length == pytest.approx(45)


def test_arcs_of_one_circle_are_joined() -> None:
    road = highway_road("roundabout")
    turn = np.linspace(1.4, -1.4, 15)  # the ring is driven with falling phases in this frame
    points = 24 * np.column_stack([np.cos(turn), np.sin(turn)])
    curves, passed = route(road, driven(road, motion(points)))
    assert len(passed) > 2 and len(curves) == 1


def test_roughness_is_the_noise_of_a_smooth_motion() -> None:
    times = 0.1 * np.arange(200)
    smooth = np.column_stack([10 * times, np.sin(times)])[:, None]
    assert roughness(smooth) < 1e-3
    noisy = smooth + 0.3 * np.random.default_rng(0).normal(size=smooth.shape)
    assert roughness(noisy) == pytest.approx(0.3, rel=0.15)
    assert np.isnan(roughness(smooth[:3]))


def test_motion_without_told_speeds_has_those_of_its_positions() -> None:
    points = along(X, 0.0)
    points[5] = np.nan
    found = motion(points)
    seen = found.seen
    assert seen.sum() == len(X) - 1
    np.testing.assert_allclose(found.speeds[seen], 10.0)
    np.testing.assert_allclose(found.headings[seen], 0.0)

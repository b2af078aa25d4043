"""Matching of cars to lanes by position and heading."""

import itertools

import numpy as np
import pytest

from olne_bench.envs.tracks import matching
from olne_bench.envs.tracks.grid import Motion
from olne_bench.envs.tracks.matching import driven, route
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.envs.tracks.road_file import highway_road
from olne_bench.games.model.lanes import ArcLane, Lane, StraightLane

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


def test_lanes_between_two_samples_are_on_the_route() -> None:
    lanes = {f"l{k}": straight((5.0 * k, 0), EAST, 5, f"l{k + 1}") for k in range(8)}
    road = Road(lanes | {"l8": straight((40.0, 0), EAST, 5)})
    legs = driven(road, motion(along(np.array([1.0, 16.0, 31.0, 44.0]), 0)))
    assert [leg.until for leg in legs[1:3]] == [5.0, 5.0] and legs[-1].until == pytest.approx(4.0)
    assert not any(leg.changed for leg in legs)
    curves, passed = route(road, legs)
    assert passed == [f"l{k}" for k in range(9)]
    (joined,) = curves  # straight lanes that go on are one
    assert joined.length == pytest.approx(45)


def test_arcs_of_one_circle_are_joined() -> None:
    road = highway_road("roundabout")
    turn = np.linspace(1.4, -1.4, 15)  # the ring is driven with falling phases in this frame
    points = 24 * np.column_stack([np.cos(turn), np.sin(turn)])
    curves, passed = route(road, driven(road, motion(points)))
    assert len(passed) > 2 and len(curves) == 1


def test_a_leg_tells_where_its_lane_was_left_and_how() -> None:
    change = driven(ROAD, motion(along(X, np.where(X < 42, 0.0, 4.0))))
    assert [(leg.lane, leg.changed) for leg in change] == [("right", True), ("left", False)]
    assert change[0].until == pytest.approx(X[X < 42][-1])
    assert change[1].until == pytest.approx(X[-1])
    up = np.linspace(3, 40, 9)
    points = np.vstack([along(X, 0.0), np.column_stack([np.full(9, 100.0), up])])
    turn = driven(ROAD, motion(points))
    assert [(leg.lane, leg.changed) for leg in turn] == [("right", False), ("off", False)]
    assert turn[-1].until == pytest.approx(40)


def test_the_cheapest_sequence_weighs_steps_against_places() -> None:
    costs = np.array([[0.0, 9.0], [3.0, 0.0], [3.0, 0.0], [0.0, 9.0]])
    dear, cheap = np.array([[0.0, 4.0], [4.0, 0.0]]), np.array([[0.0, 2.0], [2.0, 0.0]])
    assert matching._cheapest(costs, dear) == [0, 0, 0, 0]
    assert matching._cheapest(costs, cheap) == [0, 1, 1, 0]
    one_way = np.array([[0.0, 0.1], [50.0, 0.0]])
    assert matching._cheapest(costs, one_way) == [0, 0, 0, 0]
    assert matching._cheapest(costs[:3], one_way) == [0, 1, 1]
    assert matching._cheapest(costs[:1], dear) == [0]


@pytest.mark.parametrize("seed", range(3))
def test_no_sequence_is_cheaper(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs, step = rng.uniform(size=(5, 3)), rng.uniform(size=(3, 3))

    def price(lanes: tuple[int, ...] | list[int]) -> float:
        steps = sum(step[a, b] for a, b in itertools.pairwise(lanes))
        return float(steps + sum(costs[k, lane] for k, lane in enumerate(lanes)))

    best = min(price(lanes) for lanes in itertools.product(range(3), repeat=5))
    assert price(matching._cheapest(costs, step)) == pytest.approx(best)


def test_ways_lead_a_few_lanes_ahead_by_the_shortest() -> None:
    lanes = {f"l{k}": straight((5.0 * k, 0), EAST, 5, f"l{k + 1}") for k in range(6)}
    lanes["l0"] = straight((0.0, 0), EAST, 5, "l1", "short", "nowhere")
    lanes["short"] = straight((5.0, 5), EAST, 5, "l3")
    ways = matching._ways(Road(lanes | {"l6": straight((30.0, 0), EAST, 5, "l0")}))
    assert ways["l0", "l1"] == ()
    assert ways["l0", "l3"] == ("short",)
    assert ways["l1", "l5"] == ("l2", "l3", "l4")
    assert ("l1", "l6") not in ways  # too far between two samples
    assert ("l0", "nowhere") not in ways
    assert all(start != end for start, end in ways)
    assert ways["l6", "l1"] == ("l0",)


def test_a_lane_is_kept_up_to_a_distance_with_a_metre_at_least() -> None:
    lane = RoadLane((StraightLane((0, 0), EAST, 10.0), StraightLane((10, 0), NORTH, 20.0)))

    def lengths(along: float) -> list[float]:
        return [curve.length for curve in matching._until(lane, along)]

    assert lengths(-3.0) == lengths(0.5) == [1.0]
    assert lengths(10.0) == [10.0]
    assert lengths(14.0) == [10.0, 4.0]
    assert lengths(99.0) == [10.0, 20.0]


def joined(*curves: Lane) -> list[Lane]:
    found: list[Lane] = []
    for curve in curves:
        matching._append(found, curve)
    return found


def test_only_what_goes_on_alike_is_joined() -> None:
    first = StraightLane((0, 0), EAST, 10.0)
    assert joined(first, StraightLane((10, 0), EAST, 5.0)) == [StraightLane((0, 0), EAST, 15.0)]
    for other in (
        StraightLane((10, 0), NORTH, 5.0),
        StraightLane((10, 1), EAST, 5.0),
        ArcLane((10, 5), 5.0, -1.0, 0.0),
    ):
        assert joined(first, other) == [first, other]
    arc = ArcLane((0, 0), 5.0, 0.0, 1.0)
    (whole,) = joined(arc, ArcLane((0, 0), 5.0, 1.0 + 2 * np.pi, 1.5 + 2 * np.pi))
    assert isinstance(whole, ArcLane)
    assert (whole.start_phase, whole.end_phase) == (0.0, pytest.approx(1.5))
    for other in (
        ArcLane((0, 0), 5.0, 1.0, 0.5),  # back again
        ArcLane((0, 0), 6.0, 1.0, 1.5),
        ArcLane((1, 0), 5.0, 1.0, 1.5),
        first,
    ):
        assert joined(arc, other) == [arc, other]

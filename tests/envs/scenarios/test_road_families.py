"""Drivers on HighwayEnv's roads: the starts and routes of all proposals."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.envs.roads.road_scenario import DT, HORIZON, Driver
from olne_bench.envs.scenarios import highway, intersection, merge, roundabout, two_way
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.tracks.road import RoadLane, curve_points, locate
from olne_bench.envs.tracks.road_file import highway_road
from olne_bench.games.model.lanes import ArcLane, Lane, LaneKeeping, StraightLane

FAMILIES = {
    "highway": highway,
    "intersection": intersection,
    "merge": merge,
    "roundabout": roundabout,
    "two_way": two_way,
}
LENGTH, WIDTH = 5.0, 2.0  # [m] of a car
DURATION = (HORIZON - 1) * DT  # [s]


def proposals(name: str, count: int, number: int = 60) -> list[Scenario]:
    rng = np.random.default_rng(0)
    return [FAMILIES[name].propose(rng, count) for _ in range(number)]


def drivers(scenario: Scenario) -> list[Driver]:
    """Drivers read from the game: (state, route, target speed, blend)."""
    found = []
    for player, state in zip(scenario.game.players, scenario.initial_state, strict=True):
        (keeping,) = [term for term in player.task if isinstance(term, LaneKeeping)]
        target = player.preferences[1].target  # type: ignore[attr-defined]
        found.append(Driver(tuple(state), keeping.route, target, keeping.blend))
    return found


def line(route: tuple[Lane, ...]) -> np.ndarray:
    """Points of a route."""
    return np.concatenate([curve_points(curve) for curve in route])


def column(name: str, count: int, value: Callable[[list[Driver]], float]) -> np.ndarray:
    """A value of every proposal."""
    return np.array([value(drivers(scenario)) for scenario in proposals(name, count)])


def assert_spans(values: np.ndarray, low: float, high: float) -> None:
    """Check that values lie in a range and nearly fill it."""
    assert low <= values.min() <= low + 0.15 * (high - low)
    assert high - 0.15 * (high - low) <= values.max() <= high


@pytest.mark.parametrize("name", FAMILIES)
def test_families_are_those_of_the_roads(name: str) -> None:
    family = FAMILIES[name]
    (made,) = [value for value in vars(family).values() if getattr(value, "name", None) == name]
    fewest, most = family.PLAYERS
    assert made.players == (fewest, most)
    assert fewest <= made().num_players <= most
    assert name in ROAD_NAMES
    same = [made(fewest).propose(np.random.default_rng(4), fewest) for _ in range(2)]
    np.testing.assert_array_equal(same[0].initial_state, same[1].initial_state)
    assert same[0].game.num_players == fewest


@pytest.mark.parametrize("name", FAMILIES)
def test_everybody_starts_on_a_lane_along_it_and_apart_from_the_others(name: str) -> None:
    road = highway_road(name)
    for scenario in proposals(name, FAMILIES[name].PLAYERS[1], 12):
        assert scenario.name == name
        for driver in drivers(scenario):
            px, py, heading, speed = driver.state
            places = [locate(lane.line, np.array([[px, py]])) for lane in road.lanes.values()]
            here = [p for p in places if p.distance[0] < 0.05]
            assert any(abs(np.sin((p.heading[0] - heading) / 2)) < 0.02 for p in here)
            assert 0.8 * driver.target_speed <= speed <= driver.target_speed
        at = scenario.initial_state[:, :2]
        apart = np.linalg.norm(at[:, None] - at, axis=-1) + 1e3 * np.eye(len(at))
        assert apart.min() > 1.5 * WIDTH


@pytest.mark.parametrize("name", FAMILIES)
def test_routes_go_on_ahead_for_as_long_as_the_game_lasts(name: str) -> None:
    for scenario in proposals(name, FAMILIES[name].PLAYERS[1], 12):
        for driver in drivers(scenario):
            # A ramp ends before its lane, and exits begin where HighwayEnv has them.
            gaps = [
                np.linalg.norm(curve_points(after)[0] - curve_points(before)[-1])
                for before, after in pairwise(driver.route)
            ]
            assert name in ("two_way", "merge") or max(gaps, default=0.0) < 6
            line = RoadLane(driver.route).line
            ahead = RoadLane(driver.route).length
            ahead -= locate(line, np.array([driver.state[:2]])).along[0]
            # Single-lane routes extend beyond their end.
            assert name in ("highway", "merge") or ahead > driver.target_speed * DURATION


def test_on_the_highway_fast_cars_come_up_behind_slow_ones_of_their_lane() -> None:
    for scenario in proposals("highway", 8):
        cars = drivers(scenario)
        for slow, fast in zip(cars[::2], cars[1::2], strict=True):
            assert slow.state[1] == fast.state[1]
            assert slow.state[1] in (8.0, 12.0)  # the two lanes on the right
            gap = slow.state[0] - fast.state[0]
            assert gap > 2 * LENGTH
            # It passes within the game, by more than a car length.
            assert (fast.target_speed - slow.target_speed) * DURATION > gap + LENGTH
            assert slow.route == (StraightLane((0.0, slow.state[1]), (1.0, 0.0), 1e4),)
            assert fast.route[0].start[1] in (0.0, 4.0)  # type: ignore[attr-defined]
            assert slow.state[3] == slow.target_speed
            assert slow.state[2] == fast.state[2] == 0
        fronts = np.array([car.state[0] for car in cars[::2]])
        assert (np.abs(fronts - 80 - 45 * np.arange(4)) <= 5).all()
    assert_spans(column("highway", 3, lambda c: c[1].target_speed - c[1].state[3]), 1, 3)
    assert_spans(column("highway", 3, lambda c: c[0].state[0] - c[1].state[0]), *highway.GAP)
    assert_spans(column("highway", 3, lambda c: c[0].state[0]), 75, 85)
    assert_spans(column("highway", 3, lambda c: c[0].target_speed), *highway.SLOW)
    assert_spans(column("highway", 3, lambda c: c[1].target_speed), *highway.QUICK)
    lanes = column("highway", 3, lambda c: c[1].route[0].start[1])  # type: ignore[attr-defined]
    assert set(lanes) == {0.0, 4.0}


def test_cars_on_the_ramp_join_the_right_lane() -> None:
    for scenario in proposals("merge", 6):
        cars = drivers(scenario)
        for index, car in enumerate(cars):
            px, py, _, speed = car.state
            place = 180 - 22 * (index // 3) - 8 * (index % 3)
            assert abs(px - place) <= 4
            assert 0 <= car.target_speed - speed <= 2
            assert car.blend == 5
            ramp, right, left = (index % 3 == k for k in range(3))
            assert len(car.route) == (2 if ramp else 1)
            assert py == pytest.approx(0.0) if left else py >= 4
            if right or ramp:
                assert line(car.route[-1:])[:, 1] == pytest.approx(4.0)
            assert car.target_speed >= 25 if left else car.target_speed <= 25
    assert_spans(column("merge", 3, lambda c: c[0].state[0]), 176, 184)
    assert_spans(column("merge", 3, lambda c: c[1].target_speed), *merge.SPEED)
    assert_spans(column("merge", 3, lambda c: c[2].target_speed), *merge.LEFT_SPEED)
    assert_spans(column("merge", 3, lambda c: c[0].target_speed - c[0].state[3]), 0, 2)


def test_cars_from_different_arms_cross() -> None:
    ways = set()
    for scenario in proposals("intersection", 4):
        cars = drivers(scenario)
        starts = np.array([car.state[:2] for car in cars])
        out = np.array([line(car.route)[-1] for car in cars])
        came = [int(np.round(np.arctan2(y, x) / (np.pi / 2))) % 4 for x, y in starts]
        left = [int(np.round(np.arctan2(y, x) / (np.pi / 2))) % 4 for x, y in out]
        assert sorted(came) == [0, 1, 2, 3]
        assert all(a != b for a, b in zip(came, left, strict=True))  # no car turns round
        ways |= {(b - a) % 4 for a, b in zip(came, left, strict=True)}
        stop = np.array([car.route[0].length for car in cars])
        along = [locate(line(car.route[:1]), np.array([car.state[:2]])).along[0] for car in cars]
        before = stop - along
        assert (before - 8 * np.arange(4) >= intersection.DISTANCE[0] - 1e-6).all()
        assert (before - 8 * np.arange(4) <= intersection.DISTANCE[1] + 1e-6).all()
    assert ways == {1, 2, 3}
    assert_spans(column("intersection", 2, lambda c: c[0].state[3]), *intersection.SPEED)


def test_cars_on_the_ring_meet_cars_that_enter_it() -> None:
    exits = set()
    for scenario in proposals("roundabout", 4):
        for index, car in enumerate(drivers(scenario)):
            px, py, *_ = car.state
            side = 1 if index < 2 else -1  # south is down, y is larger there
            radius = np.hypot(px, py)
            circling = index % 2 == 0
            assert (radius == pytest.approx(24, abs=0.1)) == circling
            if circling:
                assert side * px < 0  # west of the southern entry, in driving direction
            else:
                assert side * py > 24
            arcs = [curve for curve in car.route if isinstance(curve, ArcLane)]
            (ring,) = [arc for arc in arcs if arc.radius == 24]
            turned = abs(ring.end_phase - ring.start_phase)
            segments = turned / (np.pi / 4)
            exits.add((circling, round(segments)))
            assert isinstance(car.route[-1], StraightLane)
            assert np.hypot(*line(car.route)[-1]) > 50  # it leaves
            assert car.target_speed == car.state[3]
    assert {segments for circling, segments in exits if circling} == {3, 5}
    assert {segments for circling, segments in exits if not circling} == {1, 3}
    assert_spans(column("roundabout", 2, lambda c: c[0].target_speed), *roundabout.RING_SPEED)
    assert_spans(column("roundabout", 2, lambda c: c[1].target_speed), *roundabout.ENTRY_SPEED)


def test_one_car_overtakes_against_oncoming_traffic() -> None:
    for scenario in proposals("two_way", 5):
        passing, slow, oncoming, behind, second = drivers(scenario)
        ahead = [car.state[0] - passing.state[0] for car in (slow, oncoming, behind, second)]
        assert passing.state[0] == 100.0
        assert two_way.GAP[0] <= ahead[0] <= two_way.GAP[1]
        assert two_way.ONCOMING_DISTANCE[0] <= ahead[1] <= two_way.ONCOMING_DISTANCE[1]
        assert two_way.SPACING[0] <= -ahead[2] <= two_way.SPACING[1]
        assert two_way.SPACING[0] <= ahead[3] - ahead[1] <= two_way.SPACING[1]
        assert passing.state[3] == passing.target_speed - 3
        left, own = passing.route
        assert left.start[1] == oncoming.state[1] != own.start[1]  # type: ignore[attr-defined]
        assert own == slow.route[0] == behind.route[0]
        assert left.direction == own.direction  # type: ignore[attr-defined]
        assert passing.blend == 8
        # It is past the slow car, and back, before it meets the first oncoming one.
        back = left.length - passing.state[0]
        assert two_way.PASSING_DISTANCE[0] <= back <= two_way.PASSING_DISTANCE[1]
        time = back / passing.target_speed
        assert back - slow.target_speed * time > ahead[0] + LENGTH
        assert ahead[1] - oncoming.target_speed * time > back
        for car in (oncoming, second):
            assert np.cos(car.state[2]) == pytest.approx(-1)
        for car in (slow, oncoming, behind, second):
            assert car.state[3] == car.target_speed
            assert two_way.SLOW[0] <= car.target_speed <= two_way.SLOW[1]
    assert_spans(column("two_way", 3, lambda c: c[0].target_speed), *two_way.QUICK)
    assert_spans(column("two_way", 3, lambda c: c[1].target_speed), *two_way.SLOW)
    oncoming = column("two_way", 3, lambda c: c[2].state[0] - 100)
    assert_spans(oncoming, *two_way.ONCOMING_DISTANCE)
    for count in (3, 4, 5):
        whole, part = (proposals("two_way", k, 1)[0].initial_state for k in (5, count))
        np.testing.assert_array_equal(whole[:count], part)

"""Cars off the road or against its lanes are refused; those just within the limits are not."""

import numpy as np
import pytest

from olne_bench.envs.tracks.grid import Motion
from olne_bench.envs.tracks.matching import MARGIN, check_on_road, lane_warnings
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.errors import UserError
from olne_bench.games.model.costs import StateDeviation
from olne_bench.games.model.game import Player
from olne_bench.games.model.lanes import ArcLane, LaneKeeping, StraightLane

WIDTH = 4.0
EAST = StraightLane((0.0, 0.0), (1.0, 0.0), 100.0)
WEST = StraightLane((100.0, 10.0), (-1.0, 0.0), 100.0)
ROAD = Road({"east": RoadLane((EAST,), WIDTH), "west": RoadLane((WEST,), WIDTH)})
X = np.arange(5.0, 95.0, 9.0)  # ten samples


def motion(y: float | np.ndarray, heading: float | np.ndarray = 0.0) -> Motion:
    return Motion(
        np.column_stack([X, np.broadcast_to(y, X.shape)]),
        np.broadcast_to(heading, X.shape).astype(float),
        np.full(X.shape, 9.0),
    )


def said_of(*motions: Motion, noise: float = 0.0) -> str:
    names = [f"car{k}" for k in range(len(motions))]
    try:
        check_on_road(ROAD, names, motions, noise)
    except UserError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("noise", [0.0, 0.4])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_may_be_half_a_width_a_margin_and_two_sigma_beside(side: float, noise: float) -> None:
    limit = WIDTH / 2 + MARGIN + 2 * noise
    assert not said_of(motion(0.0), motion(side * (limit - 0.01)), noise=noise)
    words = f"player 'car1' is off the road: at (5.0, {side * (limit + 0.01):.1f}) the nearest lane"
    far = said_of(motion(0.0), motion(side * (limit + 0.01)), noise=noise)
    assert words in far and "off the road in 100% of its samples" in far


@pytest.mark.parametrize(("count", "refused"), [(2, False), (3, True)])
def test_a_fifth_of_the_samples_may_be_off_the_road(count: int, refused: bool) -> None:
    y = np.zeros(10)
    y[4 : 4 + count] = -7.0
    y[4] = -8.0
    said = said_of(motion(y))
    assert bool(said) == refused
    if refused:
        assert "at (41.0, -8.0) the nearest lane is 8.0 m away" in said
        assert "off the road in 30% of its samples" in said


@pytest.mark.parametrize(("y", "along"), [(0.0, 0.0), (10.0, np.pi)])
@pytest.mark.parametrize("off", [-1.6, -1.5, 1.5, 1.6])
def test_a_car_drives_within_a_right_angle_of_its_lane(y: float, along: float, off: float) -> None:
    said = said_of(motion(y, along + off))
    assert bool(said) == (abs(off) > np.pi / 2)
    if said:
        degrees = f"it heads {np.rad2deg(along + off):.0f} degrees, and so in 100% of its samples"
        assert f"'car0' drives against the lanes: at (5.0, {y:.1f}) " in said and degrees in said


@pytest.mark.parametrize(("count", "refused"), [(2, False), (3, True)])
def test_a_fifth_of_the_headings_may_be_against_the_lanes(count: int, refused: bool) -> None:
    heading = np.zeros(10)
    heading[5 : 5 + count] = np.pi
    said = said_of(motion(0.0, heading))
    assert bool(said) == refused
    if refused:
        assert "at (50.0, 0.0) it heads 180 degrees, and so in 30% of its samples" in said


def test_only_lanes_that_a_car_is_on_say_which_way_to_drive() -> None:
    assert "against the lanes" in said_of(motion(0.0, np.pi))  # westward, ten metres beside
    both = motion(5.0, np.pi)
    assert "off the road" in said_of(both)
    assert not said_of(both, noise=1.1)  # on either lane, as far as can be told
    assert not said_of(motion(0.0, np.nan))
    unseen = motion(np.where(np.arange(10) < 8, np.nan, 0.0))
    assert not said_of(unseen)


def keeper(*route: StraightLane | ArcLane) -> Player:
    return Player((StateDeviation("speed", 9.0),), (LaneKeeping(route),))


@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_who_ends_beside_its_lanes_is_named(noise: float) -> None:
    limit = RoadLane((EAST,)).width / 2 + MARGIN + 2 * noise
    near, far = motion(limit - 0.01), motion(np.linspace(0, limit + 0.01, 10))
    players = [keeper(EAST), keeper(EAST), keeper(EAST)]
    told = lane_warnings(["a", "b", "c"], [near, far, motion(0.0)], players, noise)
    beside = f"{limit + 0.01:.1f}"
    assert told == [f"player 'b' ends {beside} m beside the lanes it is assumed to keep"]


def test_the_last_lane_goes_straight_on() -> None:
    short = StraightLane((0.0, 0.0), (1.0, 0.0), 30.0)
    bent = ArcLane((0.0, 8.0), 8.0, -np.pi / 2, 0.0)  # turns north at (8, 8)
    assert not lane_warnings(["a"], [motion(0.0)], [keeper(short)], 0.0)
    assert lane_warnings(["a"], [motion(0.0)], [keeper(bent)], 0.0)
    north = Motion(np.array([[0.0, 0.0], [8.0, 60.0], [np.nan, 0.0]]), np.zeros(3), np.ones(3))
    assert not lane_warnings(["a"], [north], [keeper(bent)], 0.0)
    assert lane_warnings(["a"], [north], [keeper(short)], 0.0)
    free = Player((StateDeviation("speed", 9.0),), ())
    assert not lane_warnings(["a"], [north], [free], 0.0)

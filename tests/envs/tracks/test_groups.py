"""Which cars interact."""

import numpy as np
import pytest

from olne_bench.envs.tracks.grid import Grid
from olne_bench.envs.tracks.groups import CROSSES, CUTS_IN, FOLLOWS, groups_in
from olne_bench.envs.tracks.road import Road, RoadLane
from olne_bench.games.model.lanes import StraightLane

STEP, TIMES = 0.2, 0.2 * np.arange(31)


def grid(**tracks: tuple[np.ndarray, np.ndarray]) -> Grid:
    states = np.full((len(TIMES), len(tracks), 4), np.nan)
    for i, (x, y) in enumerate(tracks.values()):
        states[:, i, 0], states[:, i, 1] = x, y
    return Grid(TIMES, [*tracks], states)


def lane(y: float) -> RoadLane:
    return RoadLane((StraightLane((-50.0, y), (1.0, 0.0), 400.0),))


ROAD = Road({"right": lane(0.0), "left": lane(4.0)})
AT = np.zeros_like(TIMES)


def test_who_follows_closely_is_with_its_leader_and_the_rest_is_alone() -> None:
    tracks = {
        "leader": (30 + 8 * TIMES, AT),
        "follower": (10 + 10 * TIMES, AT),
        "elsewhere": (-300 + 10 * TIMES, AT + 4),
    }
    (group,) = groups_in(grid(**tracks), ROAD, 5)
    (pair,) = group.interactions
    assert (pair.who, pair.what, pair.whom) == ("follower", FOLLOWS, "leader")
    assert set(group.players) == {"leader", "follower"}
    assert group.window == pytest.approx((0.0, 6.0))


def test_who_changes_in_ahead_of_somebody_is_named() -> None:
    across = np.interp(TIMES, [2, 4], [4, 0])
    tracks = {
        "ahead": (60 + 10 * TIMES, AT),
        "behind": (0 + 10 * TIMES, AT),
        "between": (25 + 10 * TIMES, across),
    }
    found = [one for g in groups_in(grid(**tracks), ROAD, 5) for one in g.interactions]
    assert ("between", CUTS_IN, "behind") in {(one.who, one.what, one.whom) for one in found}


def test_ways_that_cross_within_seconds_count_without_a_road() -> None:
    tracks = {"east": (-20 + 10 * TIMES, AT), "north": (AT, -30 + 10 * TIMES)}
    (group,) = groups_in(grid(**tracks), None, 5)
    (pair,) = group.interactions
    assert (pair.who, pair.what, pair.whom) == ("north", CROSSES, "east")
    late = tracks | {"north": (AT, -80 + 10 * TIMES)}
    assert groups_in(grid(**late), None, 5) == []


def test_groups_are_no_larger_than_asked_and_seen_together() -> None:
    tracks = {f"car {k}": (100 - 12 * k + 10 * TIMES, AT) for k in range(6)}
    for most in (2, 4):
        found = groups_in(grid(**tracks), ROAD, most)
        assert found and all(len(group.players) <= most for group in found)
    gone = tracks | {"car 0": (np.where(TIMES < 1, 100 + 10 * TIMES, np.nan), AT)}
    assert all("car 0" not in g.players for g in groups_in(grid(**gone), ROAD, 4))

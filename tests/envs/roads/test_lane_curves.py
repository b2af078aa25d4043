"""HighwayEnv's lanes as curves of a game, and chains of them."""

import numpy as np
import pytest
from highway_env.road import lane as highway_lanes

from olne_bench.envs.roads.highway_roads import appended, lane_curve
from olne_bench.envs.tracks.road import curve_points
from olne_bench.games.model.lanes import ArcLane, SineLane, StraightLane

LANES = {
    "straight": highway_lanes.StraightLane([3.0, 4.0], [33.0, 44.0]),
    "sine": highway_lanes.SineLane([0.0, 0.0], [60.0, 80.0], 3.0, 0.05, 0.7),
    "clockwise": highway_lanes.CircularLane([5.0, 6.0], 20.0, 0.4, 2.0, clockwise=True),
    "counter-clockwise": highway_lanes.CircularLane([5.0, 6.0], 20.0, 2.0, 0.4, clockwise=False),
}


@pytest.mark.parametrize("kind", LANES)
def test_a_curve_goes_where_the_lane_goes(kind: str) -> None:
    lane = LANES[kind]
    curve = lane_curve(lane)
    assert curve.length == pytest.approx(lane.length)
    points = curve_points(curve)
    places = np.array([lane.local_coordinates(point) for point in points])
    np.testing.assert_allclose(places[:, 1], 0, atol=1e-9)
    np.testing.assert_allclose(places[[0, -1], 0], [0, lane.length], atol=1e-9)
    assert (np.diff(places[:, 0]) > 0).all()
    assert isinstance(curve, {"straight": StraightLane, "sine": SineLane}.get(kind, ArcLane))


def test_arcs_of_one_circle_are_joined() -> None:
    first = ArcLane((5.0, 6.0), 20.0, 0.4, 1.0)
    onward = ArcLane((5.0, 6.0), 20.0, 1.0 - 2 * np.pi, 1.8 - 2 * np.pi)
    (joined,) = appended([first], onward)
    assert isinstance(joined, ArcLane)
    assert (joined.centre, joined.radius, joined.start_phase) == ((5.0, 6.0), 20.0, 0.4)
    assert joined.end_phase == pytest.approx(1.8)
    straight = StraightLane((0.0, 0.0), (1.0, 0.0), 9.0)
    assert appended([], first) == [first]
    assert appended([straight, first], onward) == [straight, joined]
    for other in (ArcLane((5.0, 6.0), 21.0, 1.0, 1.8), ArcLane((5.0, 6.5), 20.0, 1.0, 1.8)):
        assert appended([first], other) == [first, other]
    assert appended([straight], first) == [straight, first]
    assert appended([first], straight) == [first, straight]

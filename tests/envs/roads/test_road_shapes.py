"""HighwayEnv's lanes as outlines."""

import numpy as np
import pytest

from olne_bench.envs.roads.highway_roads import ROAD_NAMES, road_network
from olne_bench.envs.roads.road_shapes import LaneShape, lane_shapes


@pytest.mark.parametrize("name", ROAD_NAMES)
def test_edges_are_those_of_highway_envs_lanes(name):
    low, high = np.array([-70.0, -70.0]), np.array([420.0, 70.0])
    shapes = lane_shapes(name, low, high)
    lanes = road_network(name).lanes_list()
    assert 0 < len(shapes) <= len(lanes)
    for shape in shapes:
        middle = sum(edge[len(edge) // 2] for edge in shape.edges) / 2

        def fits(lane, shape=shape, middle=middle):
            along, beside = lane.local_coordinates(middle)
            places = [lane.local_coordinates(edge[len(edge) // 2])[1] for edge in shape.edges]
            half = lane.width_at(along) / 2
            return abs(beside) < 1e-6 and np.allclose(places, [-half, half], atol=1e-6)

        assert any(fits(lane) for lane in lanes)
        assert set(shape.marks) <= {"none", "dashed", "solid"}


def test_straight_lanes_are_two_points_and_others_are_followed():
    far = np.array([1000.0, 1000.0])
    assert {len(s.edges[0]) for s in lane_shapes("highway", -far, far)} == {2}
    assert max(len(s.edges[0]) for s in lane_shapes("roundabout", -far, far)) > 5


def test_only_what_is_near_is_there():
    everything = lane_shapes("roundabout", np.full(2, -500.0), np.full(2, 500.0))
    corner = lane_shapes("roundabout", np.array([0.0, 0.0]), np.array([30.0, 30.0]))
    assert 0 < len(corner) < len(everything)
    for shape in corner:
        for edge in shape.edges:
            assert ((edge > -4) & (edge < 34)).all()  # one step beyond
    assert lane_shapes("roundabout", np.full(2, 900.0), np.full(2, 950.0)) == []


def test_an_unknown_road_is_refused():
    with pytest.raises(ValueError, match="no road for 'moon'; known are: highway"):
        lane_shapes("moon", np.zeros(2), np.ones(2))


def shape(y: np.ndarray) -> LaneShape:
    """Nine points of a lane 4 m wide about y (9,), every 2 m."""
    x = 2.0 * np.arange(9)
    edges = [np.column_stack([x, y + side]) for side in (-2.0, 2.0)]
    return LaneShape((edges[0], edges[1]), ("solid", "dashed"))


def test_a_lane_is_cut_a_point_beyond_the_border():
    lane = shape(np.zeros(9))
    for (left, right), expected in {
        (5.0, 11.0): [4, 6, 8, 10, 12],
        (6.0, 10.0): [4, 6, 8, 10, 12],
        (-9.0, 3.0): [0, 2, 4],
        (13.0, 99.0): [12, 14, 16],
    }.items():
        cut = lane.clipped(np.array([left, -3.0]), np.array([right, 3.0]))
        assert cut.marks == lane.marks
        for edge in cut.edges:
            assert edge[:, 0].tolist() == expected
    one_edge = lane.clipped(np.array([5.0, 1.0]), np.array([11.0, 3.0]))
    assert [len(edge) for edge in one_edge.edges] == [5, 5]
    assert lane.clipped(np.array([5.0, 2.5]), np.array([11.0, 3.0])) is None
    assert lane.clipped(np.array([-9.0, -3.0]), np.array([-1.0, 3.0])) is None


@pytest.mark.parametrize("slope", [0.0, 1.0, -30.0])
def test_straight_is_what_bends_by_less_than_a_thousandth(slope):
    x = 2.0 * np.arange(9)
    length = 16 * np.hypot(1, slope)
    for bend, points in ((0.0, 2), (0.9e-3, 2), (1.1e-3, 9), (-1.1e-3, 9)):
        # A millimetre beside the line from end to end.
        y = slope * x + bend * np.hypot(1, slope) * (np.arange(9) == 3)
        simple = shape(y).simplified()
        assert [len(edge) for edge in simple.edges] == [points, points], length
        np.testing.assert_array_equal(simple.edges[1][[0, -1]], shape(y).edges[1][[0, -1]])
        assert simple.marks == ("solid", "dashed")

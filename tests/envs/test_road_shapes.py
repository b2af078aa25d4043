"""HighwayEnv's lanes as outlines."""

import numpy as np
import pytest

from olne_bench.envs.highway_roads import ROAD_NAMES, road_network
from olne_bench.envs.road_shapes import lane_shapes


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

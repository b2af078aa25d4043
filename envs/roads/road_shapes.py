"""Outlines of HighwayEnv's lanes, for pictures that HighwayEnv does not draw."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from highway_env.road.lane import AbstractLane, LineType

from olne_bench.envs.roads.highway_roads import road_network

_STEP = 2.0  # [m] between the points of a curved edge
_LONGEST = 2000.0  # [m] of a lane that is drawn
_MARKS = {LineType.NONE: "none", LineType.STRIPED: "dashed"}  # all others are solid


@dataclass(frozen=True)
class LaneShape:
    """A lane seen from above."""

    edges: tuple[np.ndarray, np.ndarray]  # two lines (S, 2) [m], both in the driving direction
    marks: tuple[str, str]  # how each edge is marked: ``none``, ``dashed`` or ``solid``

    def clipped(self, low: np.ndarray, high: np.ndarray) -> "LaneShape | None":
        """The part between the corners low and high (2,) [m]; None if there is none."""
        inside = np.any(
            [((edge >= low) & (edge <= high)).all(axis=1) for edge in self.edges], axis=0
        )
        places = np.flatnonzero(inside)
        if not len(places):
            return None
        part = slice(max(places[0] - 1, 0), places[-1] + 2)  # one point beyond the border
        return LaneShape((self.edges[0][part], self.edges[1][part]), self.marks)

    def simplified(self) -> "LaneShape":
        """The same lane; if both edges are straight, with their ends only."""
        if all(_is_straight(edge) for edge in self.edges):
            first, second = (edge[[0, -1]] for edge in self.edges)
            return LaneShape((first, second), self.marks)
        return self


def lane_shapes(name: str, low: np.ndarray, high: np.ndarray) -> list[LaneShape]:
    """Lanes of a road (one of ``ROAD_NAMES``) between two corners px, py [m]."""
    clipped = (shape.clipped(low, high) for shape in _all_shapes(name))
    return [shape.simplified() for shape in clipped if shape is not None]


@lru_cache(maxsize=8)
def _all_shapes(name: str) -> tuple[LaneShape, ...]:
    return tuple(_shape(lane) for lane in road_network(name).lanes_list())


def _shape(lane: AbstractLane) -> LaneShape:
    length = min(float(lane.length), _LONGEST)
    places = np.linspace(0, length, max(2, round(length / _STEP) + 1))
    first, second = (
        np.array([lane.position(s, side * lane.width_at(s) / 2) for s in places])
        for side in (-1, 1)
    )
    marks = tuple(_MARKS.get(kind, "solid") for kind in lane.line_types)
    return LaneShape((first, second), (marks[0], marks[1]))


def _is_straight(edge: np.ndarray) -> bool:
    """Whether all points lie on the line between the ends, to a millimetre."""
    along = edge[-1] - edge[0]
    aside = along[0] * (edge[:, 1] - edge[0, 1]) - along[1] * (edge[:, 0] - edge[0, 0])
    return bool(np.abs(aside).max() <= 1e-3 * max(float(np.hypot(*along)), 1e-9))

"""Lanes as lines of points, and where a car is on them."""

import casadi as ca
import numpy as np
import pytest

from olne_bench.envs.tracks.matching import shortened
from olne_bench.envs.tracks.road import Road, RoadLane, curve_points, locate
from olne_bench.games.model.lanes import ArcLane, Lane, SineLane, StraightLane

STRAIGHT = StraightLane((1.0, 2.0), (0.6, 0.8), 10.0)
SINE = SineLane(StraightLane((0.0, 0.0), (1.0, 0.0), 20.0), 2.0, np.pi / 20, -np.pi / 2)
ARC = ArcLane((0.0, 0.0), 15.0, 0.2, -1.3)  # clockwise
CURVES = {"straight": STRAIGHT, "sine": SINE, "arc": ARC}


def beside(curve: Lane, points: np.ndarray) -> np.ndarray:
    """Coordinates of points (S, 2) by the game's own lane: along and beside."""
    position = ca.SX.sym("p", 2)
    along, across, _ = curve.locate(position)
    function = ca.Function("f", [position], [along, across])
    return np.array([[float(value) for value in function(point)] for point in points])


@pytest.mark.parametrize("kind", CURVES)
def test_points_of_a_curve_lie_on_it_from_end_to_end(kind: str) -> None:
    curve = CURVES[kind]
    along, across = beside(curve, curve_points(curve)).T
    np.testing.assert_allclose(across, 0, atol=1e-9)
    np.testing.assert_allclose(along[[0, -1]], [0, curve.length], atol=1e-9)
    assert (np.diff(along) > 0).all()


@pytest.mark.parametrize("kind", CURVES)
def test_a_shortened_curve_is_the_first_part(kind: str) -> None:
    part = shortened(CURVES[kind], 4.0)
    assert part.length == pytest.approx(4.0)
    np.testing.assert_allclose(curve_points(part)[0], curve_points(CURVES[kind])[0])
    along, across = beside(CURVES[kind], curve_points(part)[-1:]).T
    np.testing.assert_allclose([*along, *across], [4.0, 0.0], atol=1e-9)
    with pytest.raises(TypeError, match="no part of a str"):
        shortened("curve", 1.0)  # type: ignore[arg-type]


def test_positions_are_located_on_a_line() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    place = locate(line, np.array([[4.0, -1.0], [11.0, 5.0], [10.0, 13.0], [-3.0, 4.0]]))
    np.testing.assert_allclose(place.along, [4, 15, 20, 0])
    np.testing.assert_allclose(place.distance, [1, 1, 3, 5])
    np.testing.assert_allclose(place.heading, [0, np.pi / 2, np.pi / 2, 0])


def test_lanes_far_from_everybody_are_left_out() -> None:
    road = Road({"here": RoadLane((STRAIGHT,)), "there": RoadLane((ARC,))})
    assert list(road.near(np.array([[2.0, 3.0]]), 3.0).lanes) == ["here"]


def test_positions_are_located_alike_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(0)
    line, positions = random.normal(size=(7, 2)), random.normal(size=(50, 2))
    whole = locate(line, positions)
    monkeypatch.setattr("olne_bench.envs.tracks.road._PAIRS", 30)
    parts = locate(line, positions)
    for name in ("along", "distance", "heading"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))

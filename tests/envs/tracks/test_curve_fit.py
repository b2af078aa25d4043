"""Straight lines and arcs fitted to lines of points."""

import numpy as np
import pytest

from olne_bench.envs.tracks.road import TOLERANCE, RoadLane, curves_through, locate
from olne_bench.games.model.lanes import ArcLane, Lane, StraightLane


def arc(radius: float, begin: float, end: float, count: int) -> np.ndarray:
    """Points (count, 2) on a circle about (3, 1)."""
    phase = np.linspace(begin, end, count)
    return np.array([3.0, 1.0]) + radius * np.column_stack([np.cos(phase), np.sin(phase)])


def beside(curve: Lane, points: np.ndarray) -> np.ndarray:
    """Distances (P,) of points from the line or circle that a curve is part of."""
    if isinstance(curve, ArcLane):
        return np.abs(np.hypot(*(points - np.array(curve.centre)).T) - curve.radius)
    assert isinstance(curve, StraightLane)
    dx, dy = (points - np.array(curve.start)).T
    return np.abs(dy * curve.direction[0] - dx * curve.direction[1])


def test_a_straight_line_of_many_points_is_one_curve() -> None:
    points = np.column_stack([np.linspace(0, 300, 50), np.linspace(5, 65, 50)])
    (curve,) = curves_through(points)
    assert isinstance(curve, StraightLane)
    assert curve.length == pytest.approx(np.hypot(300, 60))


def test_an_arc_of_many_points_is_one_curve() -> None:
    phase = np.linspace(2.0, -0.5, 60)
    points = np.array([3.0, 1.0]) + 20 * np.column_stack([np.cos(phase), np.sin(phase)])
    (curve,) = curves_through(points)
    assert isinstance(curve, ArcLane)
    np.testing.assert_allclose([*curve.centre, curve.radius], [3, 1, 20], atol=1e-6)
    np.testing.assert_allclose([curve.start_phase, curve.end_phase], [2.0, -0.5], atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_any_line_is_followed_within_the_tolerance(seed: int) -> None:
    turn = np.cumsum(np.random.default_rng(seed).normal(0, 0.03, 120))
    points = np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]), axis=0)
    curves = curves_through(points)
    assert len(curves) < 40
    line = RoadLane(curves).line
    assert locate(line, points).distance.max() < TOLERANCE + 0.02
    np.testing.assert_allclose(line[[0, -1]], points[[0, -1]], atol=1e-6)


def test_a_lane_needs_two_points() -> None:
    with pytest.raises(ValueError, match="at least two different points"):
        curves_through([[1.0, 1.0], [1.0, 1.0]])
    with pytest.raises(ValueError, match="pairs of finite numbers"):
        curves_through([[1.0, 1.0], [1.0, np.nan]])


@pytest.mark.parametrize("turned", [0.0, 1.0, 2.5])
@pytest.mark.parametrize("size", [0.9, 1.1])
def test_a_bump_is_straight_within_the_tolerance_only(size: float, turned: float) -> None:
    x = np.linspace(0, 60, 31)
    bump = np.column_stack([x, np.where(np.arange(31) == 15, size * TOLERANCE, 0)])
    rotation = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    points = bump @ rotation.T + [20.0, -7.0]
    curves = curves_through(points)
    assert (len(curves) == 1) == (size < 1)
    assert max(beside(curve, points).min() for curve in curves) < TOLERANCE


@pytest.mark.parametrize("count", [4, 5, 13, 14, 40])
def test_a_turn_after_a_straight_line_is_two_curves_that_meet(count: int) -> None:
    turn = arc(12.0, -np.pi / 2, 1.0, count=40)
    straight = np.column_stack([np.linspace(-60, 3, count), np.full(count, -11.0)])
    curves = curves_through(np.vstack([straight, turn[1:]]))
    assert [type(curve) for curve in curves] == [StraightLane, ArcLane]
    first, second = curves
    assert isinstance(second, ArcLane)
    # The straight line extends into the turn while it is within the tolerance.
    assert 62.9 < first.length < 63 + 4
    assert second.radius == pytest.approx(12.0)
    assert second.end_phase == pytest.approx(1.0)
    np.testing.assert_allclose(RoadLane((second,)).line[0], RoadLane((first,)).line[-1], atol=1e-9)


def test_each_curve_is_the_longest_that_fits() -> None:
    points = np.column_stack([np.linspace(0, 40, 81), 3 * np.sin(np.linspace(0, 7, 81))])
    curves = curves_through(points)
    ends = [int(np.argmin(np.hypot(*(points - RoadLane((c,)).line[-1]).T))) for c in curves]
    starts = [0, *ends[:-1]]
    assert ends[-1] == len(points) - 1
    for begin, end in zip(starts, ends[:-1], strict=False):
        assert len(curves_through(points[begin : end + 1])) == 1
        assert len(curves_through(points[begin : end + 2])) == 2


@pytest.mark.parametrize("begin", [0.0, 2.0, 3.0])
@pytest.mark.parametrize("sweep", [-2.4, -0.3, 0.3, 2.4])
def test_arcs_turn_the_way_their_points_do(begin: float, sweep: float) -> None:
    (curve,) = curves_through(arc(25.0, begin, begin + sweep, 30))
    assert isinstance(curve, ArcLane)
    assert curve.end_phase - curve.start_phase == pytest.approx(sweep)
    np.testing.assert_allclose(curve.centre, [3, 1], atol=1e-6)


def test_a_line_that_goes_back_on_a_circle_is_no_arc() -> None:
    there = arc(10.0, 0.0, 2.0, 21)
    curves = curves_through(np.vstack([there, there[-2:8:-1]]))
    assert len(curves) > 1
    assert RoadLane(curves).line[-1] == pytest.approx(there[9])


@pytest.mark.parametrize(("radius", "kind"), [(2e3, ArcLane), (2e5, StraightLane)])
def test_very_flat_arcs_are_straight_lines(radius: float, kind: type) -> None:
    sweep = 1.2 * np.sqrt(8 * radius * TOLERANCE) / radius if kind is ArcLane else 2e-4
    (curve,) = curves_through(arc(radius, 0.3, 0.3 + sweep, 11))
    assert isinstance(curve, kind)


def test_three_points_and_two() -> None:
    (short,) = curves_through([[0.0, 0.0], [3.0, 4.0]])
    assert isinstance(short, StraightLane)
    assert short.length == pytest.approx(5.0)
    np.testing.assert_allclose(short.direction, [0.6, 0.8])
    (bent,) = curves_through(arc(5.0, 0.0, 0.5, 3))
    assert isinstance(bent, ArcLane)
    repeated = np.repeat([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]], 2, axis=0)
    assert len(curves_through(repeated)) == 1


@pytest.mark.parametrize("shape", [(4,), (4, 3)])
def test_points_have_two_coordinates(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="pairs of finite numbers"):
        curves_through(np.arange(np.prod(shape), dtype=float).reshape(shape))

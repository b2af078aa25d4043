"""Cars that stay out of each other, against rectangles as HighwayEnv has them."""

import casadi as ca
import numpy as np
import pytest

from olne_bench.envs.drive.cars import MOTION, STEP
from olne_bench.envs.roads.footprint import CarsApart, gap, gaps
from olne_bench.games.model.costs import Stage


def margin_of(apart: CarsApart) -> ca.Function:
    states = (ca.SX.sym("one", 4), ca.SX.sym("other", 4))
    stage = Stage(0, states, None, MOTION, STEP)
    return ca.Function("margin", states, [apart.margins(stage)])


@pytest.fixture(scope="module")
def margin() -> ca.Function:
    return margin_of(CarsApart((0, 1)))


def car(px: float, py: float, heading: float = 0.0) -> np.ndarray:
    return np.array([px, py, heading, 10.0])


def test_cars_whose_circles_are_apart_do_not_touch(margin: ca.Function) -> None:
    rng = np.random.default_rng(0)
    low, high = [-7, -7, -np.pi, 0], [7, 7, np.pi, 10]
    one, other = rng.uniform(low, high, (2, 4000, 4))
    apart = np.array(margin(one.T, other.T)).ravel() >= 0
    assert 500 < apart.sum() < 3500
    assert gap(one, other)[apart].min() > 0


@pytest.mark.parametrize(
    ("other", "allowed"),
    [
        (car(0, 4), True),  # in the next lane
        (car(3, -4, np.pi), True),  # passing the other way
        (car(6.5, 0), True),  # a metre and a half behind
        (car(5.2, 0), False),
        (car(0, 2.5), False),
        (car(4.2, 1, np.pi / 4), False),
        (car(0, 0), False),
    ],
)
def test_what_is_allowed(margin: ca.Function, other: np.ndarray, allowed: bool) -> None:
    value = float(margin(car(0, 0), other))
    assert np.isfinite(value) and (value >= 0) == allowed
    assert float(margin(other, car(0, 0))) == pytest.approx(value)


def test_more_distance_is_kept_between_the_circles() -> None:
    wide = margin_of(CarsApart((0, 1), more=0.8))
    assert float(wide(car(0, 0), car(6.4, 0))) < 0 < float(wide(car(0, 0), car(6.8, 0)))
    assert float(wide(car(0, 0), car(6, 4))) > 0  # in the next lane, except side by side


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (car(8, 0), 3.0),  # bumper to bumper, 5 m long
        (car(0, 4), 2.0),  # side by side, 2 m wide
        (car(0, 5, np.pi / 2), 1.5),  # its bumper towards our side
        (car(8, 6), 5.0),  # corner to corner: 3 m ahead, 4 m beside
        (car(4, 1), 0.0),
        (car(0, 0, np.pi / 2), 0.0),  # a cross: no corner is inside the other
    ],
)
def test_gap_between_rectangles(other: np.ndarray, expected: float) -> None:
    assert gap(car(0, 0), other) == pytest.approx(expected)
    assert gap(other, car(0, 0)) == pytest.approx(expected)


def test_gaps_of_several_cars_over_time() -> None:
    states = np.array([[car(0, 0), car(8, 0), car(0, 4)], [car(0, 0), car(4, 0), car(0, 40)]])
    found = gaps(states)
    assert found.shape == (2, 3, 3)
    assert np.isinf(found[:, range(3), range(3)]).all()
    assert found[0, 0, 1:] == pytest.approx([3.0, 2.0])
    assert found[1, 0, 1] == 0

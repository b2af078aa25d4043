import numpy as np
import pytest

from olne_bench.envs.drive.footprint import gap, gaps


def car(px: float, py: float, heading: float = 0.0) -> np.ndarray:
    return np.array([px, py, heading, 10.0])


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

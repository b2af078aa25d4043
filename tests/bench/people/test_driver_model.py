"""IDM, and MOBIL that changes lanes."""

import numpy as np
import pytest

from olne_bench.bench.people.beside import Beside, Neighbour
from olne_bench.bench.people.cases import HORIZONS, Case
from olne_bench.bench.people.driver_model import Manners, fitted_manners, idm, mobil

LOGS = np.log([1.0, 1.5, 1.2, 2.0])
EAGER = Manners(0.0, 0.1)


def case(speeds: tuple[float, float], gap: float, *beside: Beside, left: float = 0.0) -> Case:
    ahead = np.array(HORIZONS)
    happened = np.column_stack([speeds[0] * ahead, left * (ahead / 4).clip(max=1)])
    found = Case(
        *("road", "piece", "calm", happened, {}, happened),
        *(np.array([gap]), np.array(speeds), np.zeros(2)),
    )
    found.beside = beside
    return found


def test_a_car_of_the_driver_model_keeps_its_distance_to_one_that_stands():
    driven = idm(case((10.0, 0.0), 30.0), LOGS)
    assert (np.diff(driven) > 0).all() and driven[-1] < 30 - 4.5


def test_who_is_slowed_takes_the_free_lane_if_it_may():
    free = Beside(3.5, None, None)
    slowed = case((15.0, 8.0), 25.0, free)
    taken = mobil(slowed, LOGS, EAGER)
    assert taken[:, 1] == pytest.approx([0.875, 1.75, 2.625, 3.5])
    assert taken[-1, 0] > idm(slowed, LOGS)[-1] + 5
    assert mobil(slowed, LOGS, Manners(0.0, np.inf))[:, 1] == pytest.approx(0)
    nobody = case((15.0, 15.0), 70.0, Beside(-3.5, Neighbour(20.0, 10.0), None))
    assert mobil(nobody, LOGS, EAGER)[:, 1] == pytest.approx(0)  # it is slower there


def test_nobody_is_cut_up():
    behind = Neighbour(8.0, 25.0)
    slowed = case((15.0, 8.0), 25.0, Beside(3.5, None, behind))
    assert mobil(slowed, LOGS, EAGER)[:, 1] == pytest.approx(0)


def test_the_polite_count_what_others_lose():
    behind = Neighbour(30.0, 16.0)
    slowed = case((15.0, 13.0), 35.0, Beside(3.5, None, behind))
    assert mobil(slowed, LOGS, EAGER)[-1, 1] == pytest.approx(3.5)
    assert mobil(slowed, LOGS, Manners(1.0, 0.1))[-1, 1] == pytest.approx(0)


def test_manners_are_those_of_the_recorded():
    free = Beside(3.5, None, None)
    changing = [case((15.0, 8.0), 25.0 + k, free, left=3.5) for k in range(5)]
    staying = [case((15.0, 8.0), 25.0 + k, free) for k in range(5)]
    for one in staying:
        one.happened[:, 0] = idm(one, LOGS)
    assert np.isfinite(fitted_manners(changing, LOGS).threshold)
    assert fitted_manners(staying, LOGS).threshold == np.inf

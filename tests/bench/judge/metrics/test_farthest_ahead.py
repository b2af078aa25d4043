"""Distance of the car that is farthest from its predicted position."""

import numpy as np
import pytest

from olne_bench.bench.judge.metrics import declare
from olne_bench.bench.judge.metrics.farthest_ahead import FarthestAhead


class Case:
    """A trial of which two seconds ahead are known."""

    def ahead(self, seconds):
        if seconds != 2.0:
            return None
        truth = np.zeros((6, 3, 4))
        predicted = truth.copy()
        predicted[-1, :, :2] = [[3.0, 4.0], [0.0, -1.0], [0.5, 0.5]]
        predicted[2] = 99.0  # on the way it does not count
        return truth, predicted


def test_the_farthest_car_counts_at_the_end():
    assert FarthestAhead().score(Case()) == pytest.approx(5.0)
    assert FarthestAhead(seconds=1.0).score(Case()) is None


def test_it_is_a_radius():
    assert declare(FarthestAhead).radius

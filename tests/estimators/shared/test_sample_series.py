"""Samples still to come, and how far apart others are."""

import numpy as np

from olne_bench.estimators.shared.sample_series import steps_apart, with_unseen


def test_what_is_still_to_come_is_missing():
    y = np.arange(6.0).reshape(3, 2, 1)
    longer = with_unseen(y, 5)
    np.testing.assert_array_equal(longer[:3], y)
    assert longer.shape == (5, 2, 1) and np.isnan(longer[3:]).all()
    np.testing.assert_array_equal(with_unseen(y, 3), y)


def test_steps_are_between_samples_of_one_player_and_component():
    seen = np.ones((3, 2, 1), dtype=bool)
    seen[1, 0] = False  # samples left: (0, 0), (0, 1), (1, 1), (2, 0), (2, 1)
    apart, same = steps_apart(seen)
    np.testing.assert_array_equal(apart[0], [0, 0, 0, 2, 0])
    np.testing.assert_array_equal(apart[1], [0, 0, 1, 0, 2])
    np.testing.assert_array_equal(same[0], [True, False, False, True, False])

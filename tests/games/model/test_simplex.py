"""The tangent of the simplex."""

import numpy as np
import pytest

from olne_bench.games.model.simplex import simplex_tangent, sum_free


def test_changes_keep_the_sum_and_are_orthonormal() -> None:
    basis = sum_free(4)
    assert basis.shape == (4, 3)
    np.testing.assert_allclose(basis.sum(axis=0), 0, atol=1e-14)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-14)


def test_players_have_changes_of_their_own() -> None:
    basis = simplex_tangent(3, 4)
    assert basis.shape == (12, 9)
    np.testing.assert_array_equal(basis[4:8, 3:6], sum_free(4))
    assert np.count_nonzero(basis) == 3 * np.count_nonzero(sum_free(4))


@pytest.mark.parametrize("basis", [sum_free(3), simplex_tangent(2, 3)])
def test_nobody_changes_what_all_share(basis: np.ndarray) -> None:
    with pytest.raises(ValueError, match="read-only"):
        basis[0, 0] = 1.0

"""Changes of theta that keep every player's sum of weights: the tangent of the simplex."""

from functools import lru_cache

import numpy as np
from scipy.linalg import block_diag, null_space


@lru_cache(maxsize=32)
def sum_free(num_weights: int) -> np.ndarray:
    """Orthonormal basis (K, K-1) of the changes of one player's weights that keep their sum."""
    basis = np.ascontiguousarray(null_space(np.ones((1, num_weights))))
    basis.setflags(write=False)  # shared by all callers
    return basis


@lru_cache(maxsize=32)
def simplex_tangent(players: int, num_weights: int) -> np.ndarray:
    """Basis (N*K, N*(K-1)) of such changes for all players."""
    basis = block_diag(*[sum_free(num_weights)] * players)
    basis.setflags(write=False)
    return basis


def theta_tangent(num_weights: int, used: np.ndarray) -> np.ndarray:
    """Basis (N*(K+U), F) of changes of weights that keep sums, and of used unknowns (N, U)."""
    return _theta_tangent(num_weights, used.shape, used.tobytes())


@lru_cache(maxsize=64)
def _theta_tangent(num_weights: int, shape: tuple[int, int], used: bytes) -> np.ndarray:
    rows = np.frombuffer(used, bool).reshape(shape)
    parts = [block_diag(sum_free(num_weights), np.eye(shape[1])[:, row]) for row in rows]
    basis = block_diag(*parts)
    basis.setflags(write=False)  # shared by all callers
    return basis

"""Samples along time: those still to come, and how far apart those that were seen are."""

import numpy as np


def with_unseen(y: np.ndarray, horizon: int) -> np.ndarray:
    """Samples (T, N, d), followed by missing ones up to a horizon."""
    unseen = np.full((horizon - len(y), *y.shape[1:]), np.nan)
    return np.concatenate([y, unseen])


def steps_apart(seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps (n, n) between samples of one player and component, and which are.

    Args:
        seen: (T, N, d) which samples there are, n of them.
    """
    step, *series = np.nonzero(seen)
    same = np.logical_and.reduce([one[:, None] == one for one in series])
    return np.where(same, np.abs(step[:, None] - step), 0), same

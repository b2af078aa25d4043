"""Whether a Dirichlet prior gives true weights any mass.

Samples of a posterior never reach what its prior excludes, so a study that asks for them is a
mistake. A single weight of a Dirichlet distribution whose K parameters are all alpha has the
distribution Beta(alpha, (K - 1) alpha).
"""

import numpy as np
from scipy.special import betainc, betaincc

#: A tail of the prior with less probability than this is never sampled.
LEAST_MASS = 1e-15


def excluded_weight(weights: np.ndarray, alpha: float, floor: float) -> tuple[int, int] | None:
    """A weight that is farther out than the prior reaches.

    Args:
        weights: (N, K) true weights, rows sum to one.
        alpha: parameter of the Dirichlet distribution.
        floor: smallest weight of an estimate; a truth below it counts as twice the floor.

    Returns:
        Player and weight whose tail has the least probability, if that is below ``LEAST_MASS``;
        None if there is none, as where alpha is 1 or less: the density then is nowhere zero.
    """
    if alpha <= 1:
        return None
    count = weights.shape[1]
    shares = np.clip((weights - floor) / (1 - count * floor), floor, 1 - floor)
    shape = alpha, (count - 1) * alpha
    tails = np.minimum(betainc(*shape, shares), betaincc(*shape, shares))
    if tails.min() >= LEAST_MASS:
        return None
    player, weight = np.unravel_index(tails.argmin(), tails.shape)
    return int(player), int(weight)

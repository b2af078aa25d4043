"""What is known of a player's weights before anything is observed: Dirichlet distributions.

A prior is a mixture of Dirichlet distributions of the shares of one player's weights above their
floor. One component with all parameters 1 is flat. All players have the same prior, independently.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, betaincc, gammaln, logsumexp

#: A tail of the prior with less probability than this is never sampled.
LEAST_MASS = 1e-15


@dataclass(frozen=True)
class WeightPrior:
    """A mixture of Dirichlet distributions.

    Raises ValueError without a component, or on a parameter or share out of range.
    """

    #: (K,) parameters of each distribution; a number stands for K equal ones.
    components: tuple[float | tuple[float, ...], ...] = (1.0,)
    shares: tuple[float, ...] = ()  # probability of each component; all are equal if empty

    def __post_init__(self) -> None:
        components = tuple(_parameters(one) for one in self.components)
        shares = tuple(float(share) for share in self.shares) or (
            1 / max(1, len(components)),
        ) * len(components)
        if not components or len(shares) != len(components):
            raise ValueError(
                f"a prior of weights needs a share for each component, got {len(components)} "
                f"components and {len(shares)} shares"
            )
        if not all(math.isfinite(s) and s > 0 for s in shares) or abs(sum(shares) - 1) > 1e-6:
            raise ValueError(f"shares of a prior must be positive and sum to one, got {shares}")
        object.__setattr__(self, "components", components)
        object.__setattr__(self, "shares", shares)

    def __repr__(self) -> str:
        """As it is made; a single component without its share."""
        if len(self.components) == 1:
            return f"WeightPrior({self.components!r})"
        return f"WeightPrior({self.components!r}, shares={self.shares!r})"

    def check(self, num_weights: int) -> None:
        """Refuse a prior of another number of weights by a ValueError that names both numbers."""
        for one in self.components:
            if isinstance(one, tuple) and len(one) != num_weights:
                raise ValueError(
                    f"the prior is of {len(one)} weights per player, the game has {num_weights}"
                )

    def parameters(self, num_weights: int) -> np.ndarray:
        """(M, K) parameters of all components."""
        rows = [(one,) * num_weights if isinstance(one, float) else one for one in self.components]
        return np.array(rows, dtype=float)

    def log_density(self, shares: np.ndarray) -> np.ndarray:
        """Log density (...) of shares (..., K) in log-ratios, the simplex's own chart.

        Its Jacobian is prod_k s_k: a component's density is proportional to prod_k s_k^alpha_k.
        """
        return np.asarray(logsumexp(self._terms(shares), axis=-1))

    def effective(self, shares: np.ndarray) -> np.ndarray:
        """(..., K) parameters of the Dirichlet distribution that touches the density from below.

        At shares (..., K) it has the same value and slope, up to a constant: mean parameters, each
        component by its probability given the shares.
        """
        terms = self._terms(shares)
        given = np.exp(terms - logsumexp(terms, axis=-1, keepdims=True))
        return np.asarray(given @ self.parameters(shares.shape[-1]))

    def mean(self, num_weights: int) -> np.ndarray:
        """(K,) mean weights."""
        rows = self.parameters(num_weights)
        return np.asarray(np.array(self.shares) @ (rows / rows.sum(axis=1, keepdims=True)))

    def matched(self, num_weights: int) -> np.ndarray:
        """(K,) parameters of one Dirichlet distribution with the same mean and spread."""
        rows, weights = self.parameters(num_weights), np.array(self.shares)
        if len(rows) == 1:
            return np.asarray(rows[0])
        totals = rows.sum(axis=1, keepdims=True)
        means = rows / totals
        mean = weights @ means
        within = weights @ (means * (1 - means) / (totals + 1))
        variance = within + weights @ (means - mean) ** 2
        total = float((mean * (1 - mean)).sum() / variance.sum()) - 1
        return np.asarray(mean * total)

    def excluded(self, weights: np.ndarray, floor: float) -> tuple[int, int] | None:
        """Player and weight of weights (N, K) that are farther out than the prior reaches; or None.

        A single weight of a Dirichlet distribution has a Beta distribution, whose tails below
        ``LEAST_MASS`` samples never reach. A weight below the floor counts as twice the floor.
        Where all parameters of a component are 1 or less, its density is nowhere zero.
        """
        count = weights.shape[1]
        if self.parameters(count).max(axis=1).min() <= 1:
            return None
        shares = np.clip((weights - floor) / (1 - count * floor), floor, 1 - floor)
        tails = np.zeros_like(shares)
        for row, share in zip(self.parameters(count), self.shares, strict=True):
            shape = row, row.sum() - row
            tails += share * np.minimum(betainc(*shape, shares), betaincc(*shape, shares))
        if tails.min() >= LEAST_MASS:
            return None
        player, weight = np.unravel_index(tails.argmin(), tails.shape)
        return int(player), int(weight)

    def sample(self, rng: np.random.Generator, players: int, num_weights: int) -> np.ndarray:
        """Weights (N, K), each row drawn by itself."""
        chosen = rng.choice(len(self.shares), players, p=np.array(self.shares))
        rows = self.parameters(num_weights)
        return np.stack([rng.dirichlet(rows[k]) for k in chosen])

    def _terms(self, shares: np.ndarray) -> np.ndarray:
        """(..., M) log of each component's part of the density in log-ratios."""
        rows = self.parameters(shares.shape[-1])
        scale = gammaln(rows.sum(axis=1)) - gammaln(rows).sum(axis=1) + np.log(self.shares)
        logs = np.log(np.maximum(shares, np.finfo(float).tiny))
        return np.asarray(logs @ rows.T + scale)


def _parameters(given: float | Sequence[float]) -> float | tuple[float, ...]:
    numbers = (given,) if isinstance(given, int | float) else tuple(given)
    if not numbers or not all(math.isfinite(n) and n > 0 for n in numbers):
        raise ValueError(
            f"parameters of a Dirichlet distribution must be positive and finite, got {given!r}"
        )
    return float(numbers[0]) if isinstance(given, int | float) else tuple(map(float, numbers))


#: Nothing is known: all weights that sum to one are as probable.
FLAT = WeightPrior()

"""How a scenario draws its players' true weights.

Truths near equal weights flatter whatever shrinks towards them. The flat Dirichlet distribution
prefers no weights to others: its mean is the uniform ones, and some weights are close to zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from olne_bench.games.model.weight_prior import WeightPrior

#: Weights as published, or as a family drew them first: each from 0.2 to 1 before they are scaled.
PUBLISHED, MODERATE = "published", "moderate"

#: The Dirichlet distribution with the mean and spread of moderate weights, within 4 %, of 2 to 5.
MODERATE_PRIOR = WeightPrior((6.0,))

#: Each player's weights are uniform on the simplex.
DIRICHLET = "dirichlet"

#: Each player has a temperament (``envs.roads.temperaments``).
TEMPERED = "temperaments"


def check_kind(given: object, known: Sequence[str]) -> None:
    """Refuse a kind of weights that a scenario does not draw; ValueError names the alternatives."""
    if given not in known:
        raise ValueError(f"weights must be one of {', '.join(known)}, got {given!r}")


@dataclass(frozen=True)
class PublishedOrDrawn:
    """A published scenario, or the same players with weights that each seed draws."""

    #: ``published``, or ``dirichlet`` for weights that are uniform on the simplex.
    weights: str = PUBLISHED

    def __post_init__(self) -> None:
        check_kind(self.weights, (PUBLISHED, DIRICHLET))

    @property
    def fixed(self) -> bool:
        """Whether all seeds draw the same."""
        return self.weights == PUBLISHED

    def drawn(self, published: np.ndarray, seed: int) -> np.ndarray:
        """The published weights (N, K), or those of a seed."""
        return published if self.fixed else flat_dirichlet(seed, *published.shape)


def flat_dirichlet(seed: int, players: int, weights: int) -> np.ndarray:
    """Weights (N, K), each row uniform on the simplex, of the seed and their number alone.

    Where a proposal is refused, the next one has the same weights, as otherwise weights that are
    easy to play would be drawn more often.
    """
    rng = np.random.default_rng([seed, players, weights, 0x57])
    return rng.dirichlet(np.ones(weights), players)

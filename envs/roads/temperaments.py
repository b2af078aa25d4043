"""Temperaments of drivers: distributions of the true weights of who drives on HighwayEnv's roads.

Each driver has one of three, a Dirichlet distribution of the weights; a driver of unknown
temperament has a mixture of them. They overlap: exact weights do not always tell the temperament.
"""

from collections.abc import Mapping
from math import isfinite

import numpy as np
from scipy.special import gammaln

from olne_bench.checks import as_text
from olne_bench.games.model.weight_prior import WeightPrior

#: Parameters of each temperament's Dirichlet distribution, in the order of ``PREFERENCES``.
TEMPERAMENTS: dict[str, tuple[float, float, float, float]] = {
    "aggressive": (1.5, 7.0, 1.5, 2.0),
    "normal": (3.0, 3.0, 3.0, 3.0),
    "cautious": (7.0, 2.0, 2.0, 2.0),
}
#: Preferences of drivers on the roads, in the order of their weights.
PREFERENCES = ("proximity", "speed", "acceleration", "steering")

#: Weights count as at least this much, as densities are not defined at zero.
LEAST_WEIGHT = 1e-5


def checked_shares(shares: Mapping[str, float] | None) -> dict[str, float]:
    """The share of each temperament; one that is not named has none. None makes all equal.

    Raises ValueError on an unknown temperament, a share out of range, or a sum other than one.
    """
    known = ", ".join(TEMPERAMENTS)
    if shares is None:
        return dict.fromkeys(TEMPERAMENTS, 1 / len(TEMPERAMENTS))
    if not isinstance(shares, Mapping):
        raise ValueError(f"shares must be a table of temperaments ({known}), got {shares!r}")
    for name, share in shares.items():
        if name not in TEMPERAMENTS:
            raise ValueError(f"shares name an unknown temperament {name!r}; known are: {known}")
        number = isinstance(share, int | float) and not isinstance(share, bool)
        if not (number and isfinite(share) and 0 <= share <= 1):
            raise ValueError(f"the share of {name!r} must be 0 to 1, got {as_text(share)}")
    total = float(sum(shares.values()))
    if abs(total - 1) > 1e-6:
        raise ValueError(f"shares of temperaments must sum to 1, got {total:g}")
    return {name: shares.get(name, 0.0) / total for name in TEMPERAMENTS}


def drawn_temperaments(seed: int, players: int, shares: Mapping[str, float]) -> tuple[str, ...]:
    """The temperament of each player, a function of the seed, their number and the shares."""
    rng = np.random.default_rng([seed, players, 0x7E])
    chosen = rng.choice(len(TEMPERAMENTS), players, p=[shares[name] for name in TEMPERAMENTS])
    names = list(TEMPERAMENTS)
    return tuple(names[k] for k in chosen)


def tempered_weights(seed: int, temperaments: tuple[str, ...]) -> np.ndarray:
    """Weights (N, 4) of players with these temperaments, a function of both and the seed."""
    rng = np.random.default_rng([seed, len(temperaments), 0x7F])
    return np.stack([rng.dirichlet(TEMPERAMENTS[name]) for name in temperaments])


def tempered_prior(shares: Mapping[str, float]) -> WeightPrior:
    """The distribution of the weights of a driver of unknown temperament."""
    there = [name for name in TEMPERAMENTS if shares[name] > 0]
    return WeightPrior(
        tuple(TEMPERAMENTS[name] for name in there), tuple(shares[name] for name in there)
    )


def recognised(weights: np.ndarray, shares: Mapping[str, float]) -> np.ndarray:
    """Temperaments with the largest part of the mixture's density: names (...) of weights (..., 4).

    The scale of weights does not count.
    """
    positive = np.maximum(weights / weights.sum(axis=-1, keepdims=True), LEAST_WEIGHT)
    logs = np.log(positive / positive.sum(axis=-1, keepdims=True))
    parameters = np.array(list(TEMPERAMENTS.values()))
    scale = gammaln(parameters.sum(axis=1)) - gammaln(parameters).sum(axis=1)
    with np.errstate(divide="ignore"):
        prior = np.log([shares[name] for name in TEMPERAMENTS])
    densities = logs @ (parameters - 1).T + scale + prior
    return np.asarray(np.array(list(TEMPERAMENTS))[np.argmax(densities, axis=-1)])

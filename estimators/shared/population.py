"""A prior fitted to many drivers: the Dirichlet distribution from which their weights come.

Empirical Bayes. With M samples of a motion's posterior under a prior p_0, the likelihood of the
parameters alpha of another prior is, up to a constant,

    (E1)  L(alpha) = prod_motions  1/M sum_s prod_i Dir(w_si; alpha) / p_0(w_si),

over the samples s and the players i. Its maximum is sought over log alpha; a wide normal prior of
these keeps them finite where all drivers are alike.
"""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize
from scipy.special import logsumexp

from olne_bench.games.model.weight_prior import WeightPrior

#: Median and deviation a priori of log alpha, and its range.
_MEDIAN, _SPREAD, _RANGE = 0.0, 2.0, (-3.0, 6.0)


def fitted_population(samples: Sequence[np.ndarray], used: WeightPrior) -> WeightPrior:
    """The Dirichlet distribution that explains samples (M, N, K) of several motions best, by (E1).

    They were drawn with the prior ``used``, with equal probability. Raises ValueError on fewer than
    three drivers, or samples that are no positive weights.
    """
    drivers = sum(one.shape[1] for one in samples)
    if drivers < 3:
        raise ValueError(f"a population needs at least 3 drivers, got {drivers}")
    if not all((one > 0).all() and np.isfinite(one).all() for one in samples):
        raise ValueError("samples of weights must be positive and finite")
    count = samples[0].shape[2]
    before = [used.log_density(one).sum(axis=1) for one in samples]

    def cost(logs: np.ndarray) -> float:
        prior = WeightPrior((tuple(np.exp(logs)),))
        likely = sum(
            float(logsumexp(prior.log_density(one).sum(axis=1) - known) - np.log(len(one)))
            for one, known in zip(samples, before, strict=True)
        )
        return float(((logs - _MEDIAN) ** 2).sum() / (2 * _SPREAD**2)) - likely

    start = np.log(np.clip(used.matched(count), *np.exp(_RANGE)))
    found = minimize(cost, start, bounds=[_RANGE] * count, method="L-BFGS-B")
    return WeightPrior((tuple(float(value) for value in np.exp(found.x)),))

"""Whether the standard deviations of estimated parameters cover the true ones."""

import numpy as np
from scipy.special import ndtri

from olne_bench.bench.judge.metrics.judged import Judged

_WIDTH = float(ndtri(0.975))  # of a 95 % interval, in standard deviations


class CoversParameters:
    """Share of the 95 % intervals of single parameters that hold the true values."""

    name = "covers_parameters"
    label = "parameters covered"
    worst = 1.0
    summary = "share"

    def score(self, case: Judged) -> float | None:
        """Share of the trial's parameters; None without parameters, deviations or noise."""
        truth, estimate = case.recordings[0].scenario.parameters, case.estimate
        if truth is None or case.sigma == 0:
            return None
        if estimate.parameters is None or estimate.parameter_deviations is None:
            return None
        within = np.abs(estimate.parameters - truth) <= _WIDTH * estimate.parameter_deviations
        return float(np.mean(within[np.isfinite(truth)]))

"""Whether samples are calibrated around points that have nothing to do with them."""

import numpy as np

from olne_bench.bench.judge.metrics.judged import Judged
from olne_bench.bench.judge.seeds import generator_of


class TarpLevel:
    """Share of samples closer to a random point than the truth is.

    Tests of accuracy with random points (Lemos et al. 2023): levels are uniform between 0 and 1 for
    every distribution of the point if, and only if, samples come from the posterior. Here the point
    is uniform on the simplex and a function of the samples.
    """

    name = "tarp_level"
    label = "TARP level"
    worst = 1.0
    summary = "level"

    def score(self, case: Judged) -> float | None:
        """Between 0 and 1; None without samples, and without noise."""
        samples = case.estimate.samples
        if samples is None or case.sigma == 0:
            return None
        random = generator_of(samples)
        players, count = case.weights.shape
        point = random.dirichlet(np.ones(count), players)
        distances = np.linalg.norm((samples - point).reshape(len(samples), -1), axis=1)
        return float(np.mean(distances < np.linalg.norm(case.weights - point)))

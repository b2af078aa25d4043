"""How well samples of single weights foretell the true ones."""

import numpy as np
import scoringrules

from olne_bench.bench.judge.metrics.judged import Judged


class Crps:
    """Continuous ranked probability score, mean over all weights; a proper score.

    An estimate without samples counts as certain: its score is its mean absolute error.
    """

    name = "crps"
    label = "CRPS"
    drawn = False

    def score(self, case: Judged) -> float | None:
        """In units of weights."""
        estimate = case.estimate
        samples = estimate.weights[None] if estimate.samples is None else estimate.samples
        scores = scoringrules.crps_ensemble(case.weights, np.moveaxis(samples, 0, -1))
        return float(np.mean(scores))

"""How well an estimate foretells positions that no estimator has seen, in one number."""

import numpy as np
from scipy.special import logsumexp

from olne_bench.bench.judge.metrics.judged import HeldOut, Judged
from olne_bench.bench.judge.seeds import generator_of

#: Samples that predict, evenly spaced among those of the estimate.
SAMPLES = 100


class HeldOutLogScore:
    """Log density of measured positions on held-out motions, less that of knowing the truth.

    An estimate foretells a position by the mixture of its samples' predictions, each with the noise
    of the measurement; one without samples counts as certain. A proper score (Gneiting and Raftery
    2007). A sample without a game foretells nothing.
    """

    name = "held_out_log_score"
    label = "log score lost, held out"
    unit = "nats"
    needs_prediction = True
    drawn = False

    def score(self, case: Judged) -> float | None:
        """Mean over starts, times and players [nats]; None without noise, or as ``held_out``."""
        found = case.held_out() if case.sigma > 0 else None
        if not found:
            return None
        samples = case.held_out_samples(SAMPLES)
        if samples is None:
            samples = np.stack([one.prediction[None] for one in found])
        lost = [_lost(*pair, case.sigma) for pair in zip(found, samples, strict=True)]
        return float(np.mean(lost)) if np.isfinite(lost).all() else None


def _lost(one: HeldOut, predictions: np.ndarray, sigma: float) -> float:
    """Mean over all positions but the first, which are known, of predictions (M, T, N, n)."""
    true = one.states[1:, :, :2]
    noise = generator_of(true).standard_normal(true.shape)
    errors = (predictions[:, 1:, :, :2] - true) / sigma - noise
    log_densities = -np.sum(errors**2, axis=-1) / 2
    playable = np.isfinite(log_densities).all(axis=(1, 2))
    if not playable.any():
        return np.inf
    mixture = logsumexp(log_densities[playable], axis=0) - np.log(len(predictions))
    return float(np.mean(-np.sum(noise**2, axis=-1) / 2 - mixture))

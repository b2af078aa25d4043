"""Where each true weight lies in what an estimate says about it."""

import numpy as np
from scipy.special import ndtr

from olne_bench.estimators.protocol import COVARIANCE, SAMPLES, Estimate

_EXACT = 1e-9  # errors of weights, which sum to one


def weight_levels(weights: np.ndarray, estimate: Estimate) -> np.ndarray | None:
    """Probability (N, K), to the estimate, that each weight is below its true value (N, K).

    Of samples it is the rank of the truth among them (simulation-based calibration: Talts et al.
    2018), of a covariance the normal probability; None of other regions. If an estimate is
    calibrated, levels are uniform between 0 and 1.
    """
    if estimate.region == SAMPLES and estimate.samples is not None:
        below, same = estimate.samples < weights, estimate.samples == weights
        return np.asarray(below.mean(axis=0) + same.mean(axis=0) / 2)
    if estimate.region == COVARIANCE and estimate.covariance is not None:
        deviations = np.sqrt(np.clip(np.diag(estimate.covariance), 0, None)).reshape(weights.shape)
        away = weights - estimate.weights
        away[np.abs(away) <= _EXACT] = 0.0
        with np.errstate(divide="ignore"):
            scaled = np.divide(away, deviations, out=np.zeros_like(away), where=away != 0)
        return np.asarray(ndtr(scaled))
    return None

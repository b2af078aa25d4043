"""The level of the smallest region around an estimate that holds the truth."""

from scipy.special import chdtr

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.judged import Judged
from olne_bench.estimators.protocol import LIKELIHOOD, POSTERIOR, SAMPLES


class CredibleLevel:
    """Level of the smallest region of an estimate that holds the true weights."""

    name = "credible_level"
    label = "credible level"
    worst = 1.0
    summary = "level"

    def score(self, case: Judged) -> float | None:
        """0 where the estimate is the truth, 1 where no region holds it; None without a region."""
        return level_of(case)


def level_of(case: Judged) -> float | None:
    """As ``CredibleLevel.score``; also None without noise, where nothing is uncertain."""
    estimate = case.estimate
    if estimate.region is None or case.sigma == 0:
        return None
    if estimate.region in (LIKELIHOOD, POSTERIOR):
        likely = estimate.region == LIKELIHOOD
        ratio = case.likelihood_ratio() if likely else case.posterior_ratio()
        players, count = case.weights.shape
        return None if ratio is None else float(chdtr(players * (count - 1), max(0.0, ratio)))
    if estimate.region == SAMPLES:
        assert estimate.samples is not None, "the referee has checked the region"
        return formulas.sample_level(case.weights, estimate.samples)
    assert estimate.covariance is not None, "the referee has checked the region"
    return formulas.ellipsoid_level(case.weights, estimate.weights, estimate.covariance)

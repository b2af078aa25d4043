"""Whether the covariance of an estimate covers the truth."""

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.judged import Judged


class CoversTruth:
    """Share of the estimates' 95 % ellipsoids that hold the true weights."""

    name = "covers_truth"
    label = "covered"
    worst = 1.0
    summary = "share"

    def score(self, case: Judged) -> float | None:
        """1 if the ellipsoid holds the truth, else 0; None without a covariance or noise."""
        covariance = case.estimate.covariance
        if covariance is None or case.sigma == 0:
            return None
        return float(formulas.covers_truth(case.weights, case.estimate.weights, covariance))

"""How wide the region around an estimate is."""

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.judged import Judged


class RegionWidth:
    """Standard deviation of weights in the region of an estimate, geometric mean over directions.

    The volume of a region as one length: among regions that hold the truth as often as they claim,
    the narrower one knows more. A ``likelihood`` region has the width of the covariance that is
    given with it.
    """

    name = "region_width"
    label = "region width"
    drawn = False

    def score(self, case: Judged) -> float | None:
        """In units of weights; None without a region, and without noise."""
        estimate = case.estimate
        if estimate.region is None or case.sigma == 0:
            return None
        if estimate.samples is not None:
            return formulas.sample_width(estimate.samples)
        if estimate.covariance is not None:
            return formulas.covariance_width(estimate.covariance, case.weights.shape)
        return None

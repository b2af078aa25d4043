"""How far the estimated weights point away from the true ones."""

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.judged import Judged


class CosineError:
    """One minus the cosine of the angle between estimated and true weights, mean over players."""

    name = "cosine_error"
    label = "cosine error"
    worst = 1.0  # weights are not negative, so angles are at most 90 degrees
    gated = True
    compared = True
    negligible = 1e-7

    def score(self, case: Judged) -> float | None:
        """Peters et al. 2021, eqn. cosine_metric."""
        return formulas.cosine_error(case.weights, case.estimate.weights)

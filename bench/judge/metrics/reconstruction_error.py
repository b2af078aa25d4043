"""Error of the estimator's own trajectory."""

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.judged import Judged


class ReconstructionError:
    """Mean absolute difference of positions of the estimator's own trajectory to the truth."""

    name = "reconstruction_error"
    label = "reconstruction error"
    unit = "m"
    gated = True
    negligible = 1e-5

    def score(self, case: Judged) -> float | None:
        """Error of the first recording [m]; None if the estimator returned no trajectory."""
        if case.estimate.states is None:
            return None
        return formulas.position_error(case.states, case.estimate.states)

"""Error of the predicted motion."""

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.judged import Judged


class PositionError:
    """Mean absolute difference of positions to the truth, predicted at the estimated weights."""

    name = "position_error"
    label = "position error"
    unit = "m"
    needs_prediction = True
    gated = True
    compared = True
    negligible = 1e-5

    def score(self, case: Judged) -> float | None:
        """Error of the first recording [m], from whose start the prediction begins."""
        if case.prediction is None:
            return None
        return formulas.position_error(case.states, case.prediction)

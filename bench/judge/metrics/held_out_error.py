"""Error of predicted motions that no estimator has seen."""

import numpy as np

from olne_bench.bench.judge.metrics import formulas
from olne_bench.bench.judge.metrics.judged import Judged


class HeldOutError:
    """Position error of predictions from five other starts, which no estimator has seen."""

    name = "held_out_error"
    label = "held-out error"
    unit = "m"
    needs_prediction = True
    gated = True
    negligible = 1e-5

    def score(self, case: Judged) -> float | None:
        """Mean over the held-out starts [m]; None if there are none or a prediction fails."""
        found = case.held_out()
        if not found:
            return None
        return float(np.mean([formulas.position_error(o.states, o.prediction) for o in found]))

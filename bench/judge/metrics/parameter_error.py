"""How far the estimated parameters are from the true ones."""

import numpy as np

from olne_bench.bench.judge.metrics.judged import Judged


class ParameterError:
    """Mean absolute error of the parameters, each over its prior's standard deviation."""

    name = "parameter_error"
    label = "parameter error"
    unit = "deviations"
    worst = 3.0
    gated = True
    compared = True

    def score(self, case: Judged) -> float | None:
        """None where only weights are unknown."""
        scenario = case.recordings[0].scenario
        if scenario.parameters is None or case.estimate.parameters is None:
            return None
        known = scenario.told.parameters
        errors = np.abs(case.estimate.parameters - scenario.parameters) / known.deviations
        return float(np.nanmean(errors))

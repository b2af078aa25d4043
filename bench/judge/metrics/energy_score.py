"""How well samples of the weights foretell the truth, in one number."""

import scoringrules

from olne_bench.bench.judge.metrics.judged import Judged


class EnergyScore:
    """Distance of samples to the truth less half of that to each other; a proper score.

    No one gains by samples that are wider or narrower than their belief (Gneiting and Raftery
    2007). An estimate without samples counts as certain: its score is its distance to the truth.
    """

    name = "energy_score"
    label = "energy score"
    drawn = False

    def score(self, case: Judged) -> float | None:
        """In units of weights, over all players together."""
        estimate = case.estimate
        samples = estimate.weights[None] if estimate.samples is None else estimate.samples
        found = scoringrules.es_ensemble(case.weights.ravel(), samples.reshape(len(samples), -1))
        return max(0.0, float(found))

"""Whether the region of an estimate covers the truth."""

from olne_bench.bench.judge.metrics.credible_level import level_of
from olne_bench.bench.judge.metrics.judged import Judged

_LEVEL = 0.95


class CoversTruth:
    """Share of the estimates' 95 % regions that hold the true weights."""

    name = "covers_truth"
    label = "covered"
    worst = 1.0
    summary = "share"

    def score(self, case: Judged) -> float | None:
        """1 if the region holds the truth, else 0; None without a region or noise."""
        level = level_of(case)
        return None if level is None else float(level <= _LEVEL)

"""Metrics, one file each: a class with ``name``, what it declares of itself, and ``score``.

``judged.Judged`` is what a metric is given, ``declaration.MetricDeclaration`` what it may declare,
and ``scoring.score_all`` asks all of them. What a scenario identifies at all is no metric: it is a
property of the scenario, worked out once for all trials (``bench.report.statistics``).
"""

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.covers_truth import CoversTruth
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declare
from olne_bench.bench.judge.metrics.held_out_error import HeldOutError
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.judge.metrics.reconstruction_error import ReconstructionError

#: In the order in which a report shows them; others follow.
BUILT_IN: tuple[MetricDeclaration, ...] = tuple(
    declare(metric)
    for metric in (PositionError, HeldOutError, CosineError, ReconstructionError, CoversTruth)
)

"""Metrics, one file each: a class with ``name``, further declared attributes, and ``score``.

A metric is given a ``judged.Judged``. ``declaration.MetricDeclaration`` lists what it may declare.
"""

from olne_bench.bench.judge.metrics.ahead_error import AheadError
from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.covers_parameters import CoversParameters
from olne_bench.bench.judge.metrics.covers_truth import CoversTruth
from olne_bench.bench.judge.metrics.credible_level import CredibleLevel
from olne_bench.bench.judge.metrics.crps import Crps
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declare
from olne_bench.bench.judge.metrics.energy_score import EnergyScore
from olne_bench.bench.judge.metrics.farthest_ahead import FarthestAhead
from olne_bench.bench.judge.metrics.held_out_error import HeldOutError
from olne_bench.bench.judge.metrics.held_out_log_score import HeldOutLogScore
from olne_bench.bench.judge.metrics.parameter_error import ParameterError
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.judge.metrics.reconstruction_error import ReconstructionError
from olne_bench.bench.judge.metrics.region_width import RegionWidth
from olne_bench.bench.judge.metrics.tarp_level import TarpLevel

#: Built-in metrics in the order in which a report shows them; others follow.
BUILT_IN: tuple[MetricDeclaration, ...] = tuple(
    declare(metric)
    for metric in (
        *(PositionError, HeldOutError, AheadError, FarthestAhead, CosineError, ParameterError),
        *(ReconstructionError, CoversTruth, CoversParameters),
        *(RegionWidth, CredibleLevel, TarpLevel, EnergyScore, Crps, HeldOutLogScore),
    )
)

"""Test whether errors with a fresh salt are as small as those that were submitted.

Rows that were made up, or made by an estimator that knows the noise of a published salt, are better
than rows with other noise can be. Errors of one scenario, sensor and noise level (a cell) have the
same distribution whatever the salt, so submitted and fresh ones are exchangeable: a permutation
test within cells tells whether the fresh ones are larger. It assumes independent cells. Cells of a
family share their draws, so there it refuses somewhat more often than ``LEVEL``.
"""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import rankdata

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.statistics.attempts import attempts_of, errors_of, noisy, quantile
from olne_bench.bench.report.study import Study

#: Chance that an honest submission is refused by this test.
LEVEL = 0.001
_PERMUTATIONS = 10_000
_CELL = ["scenario", "sensor", "sigma"]


@dataclass(frozen=True)
class FreshErrors:
    """How an estimator does with a fresh salt.

    Attributes:
        estimator: label of the estimator.
        metric: name of the metric that is compared.
        trials: number of fresh trials.
        submitted: median error of the submitted rows of the same cells.
        fresh: median error of the fresh trials.
        p: chance of fresh errors this much larger, or more, if the salt makes no difference.
        decides: whether there are enough rows for a p-value as small as ``LEVEL``.
    """

    estimator: str
    metric: str
    trials: int
    submitted: float
    fresh: float
    p: float
    decides: bool

    @property
    def accepted(self) -> bool:
        """Whether chance explains the difference."""
        return self.p >= LEVEL


def compare_fresh(
    rows: pd.DataFrame, fresh: pd.DataFrame, metric: MetricDeclaration, study: Study
) -> list[FreshErrors]:
    """Compare errors of fresh trials with those submitted, estimator by estimator.

    Failures count as infinitely large. The statistic is the sum of the fresh errors' ranks within
    their cell, each divided by the size of the cell. The test is one-sided.

    Args:
        rows: submitted trials.
        fresh: trials with another salt, of estimators and cells of the rows.
        metric: metric that is compared.
        study: study of the run.
    """
    rows, fresh = (noisy(attempts_of(table), study) for table in (rows, fresh))
    found = []
    for estimator, ours in fresh.groupby("estimator", sort=True):
        theirs = rows[rows["estimator"] == estimator].merge(ours[_CELL].drop_duplicates(), on=_CELL)
        submitted = {place: errors_of(cell, metric) for place, cell in theirs.groupby(_CELL)}
        cells = [
            (errors_of(cell, metric), submitted.get(place, np.empty(0)))
            for place, cell in ours.groupby(_CELL, sort=True)
        ]
        orders = math.prod(math.comb(len(a) + len(b), len(a)) for a, b in cells)
        found.append(
            FreshErrors(
                estimator=str(estimator),
                metric=metric.name,
                trials=len(ours),
                submitted=_median(errors_of(theirs, metric)),
                fresh=_median(errors_of(ours, metric)),
                p=_chance(cells),
                decides=orders * LEVEL > 1,
            )
        )
    return found


def _median(values: np.ndarray) -> float:
    return quantile(values, np.ones(len(values), int), 0.5)


def _chance(cells: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """One-sided p-value over cells of fresh and submitted errors."""
    rng = np.random.default_rng(0)
    observed, permuted = 0.0, np.zeros(_PERMUTATIONS)
    for fresh, submitted in cells:
        pooled = np.concatenate([fresh, submitted])
        ranks = rankdata(pooled) / len(pooled)
        observed += ranks[: len(fresh)].sum()
        shuffled = rng.permuted(np.tile(ranks, (_PERMUTATIONS, 1)), axis=1)
        permuted += shuffled[:, : len(fresh)].sum(axis=1)
    # The observed order is one of the permutations.
    as_large = int((permuted >= observed - 1e-9).sum())
    return (1 + as_large) / (1 + _PERMUTATIONS)

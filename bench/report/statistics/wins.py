"""Wins: in how many draws one estimator has smaller errors than another, road by road and in all.

A draw is one piece of luck: in a family a seed, with all its noise levels and sensors; in a fixed
scenario a noise draw, with all sensors. Of two estimators, the one with the smaller error in more
of a draw's trials wins the draw. So the draws are independent, and those of several scenarios can
be counted together.
"""

from itertools import combinations

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.measures import compared, in_table
from olne_bench.bench.report.statistics.attempts import attempts_of, measured, noisy
from olne_bench.bench.report.statistics.estimator_comparison import (
    NEEDED,
    adjusted,
    paired_advantages,
    paired_errors,
    permutation_p,
)
from olne_bench.bench.report.statistics.intervals import share_interval
from olne_bench.bench.report.study import USUAL, Study

#: In place of a scenario: the draws of all scenarios.
ALL = "all scenarios"

_PAIR = ["estimator", "other"]
_COUNTS = ["won", "even", "lost"]
_KEY = ["error", "scenario", *_PAIR]


def win_counts(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """Count the draws that each estimator wins against each other one.

    Failures lose, ties are those of ``estimator_comparison``. Rows without noise count in families
    only.

    Args:
        trials: one row per trial.
        study: study of the run.

    Returns:
        Columns ``error, scenario, estimator, other``, and the numbers of draws that ``estimator``
        has ``won``, ``even`` ones, and those that it has ``lost``.
    """
    metrics = in_table(compared(study.metrics), trials)
    attempts = noisy(attempts_of(trials[[*NEEDED, *(metric.name for metric in metrics)]]), study)
    rows = []
    for metric in metrics:
        told = attempts[measured(attempts, metric, study)]
        for scenario, own in told.groupby("scenario", sort=True):
            parts = dict(list(own.groupby("estimator", sort=True)))
            draw = ["seed"] if study.is_family(str(scenario)) else ["sigma", "seed"]
            for first, second in combinations(parts, 2):
                counts = _counted(parts[first], parts[second], metric, draw)
                if sum(counts):
                    rows.append((metric.name, scenario, first, second, *counts))
    return pd.DataFrame(rows, columns=[*_KEY, *_COUNTS])


def win_table(counts: pd.DataFrame) -> pd.DataFrame:
    """Shares of draws won, scenario by scenario and, with two or more of these, over all of them.

    Each draw counts once. If neither estimator were better, it would go to either with equal
    chance, whatever the scenario.

    Args:
        counts: from ``win_counts``.

    Returns:
        The counts, with rows of the scenario ``ALL`` first; ``draws``; ``wins``, the share of draws
        won, an even one counting half, with ``wins_low`` and ``wins_high`` (95 %); ``p`` of an
        exact sign test, and ``p_holm``, adjusted after Holm for all rows of the table.
    """
    scenarios = counts.groupby("scenario").ngroups
    pooled = counts.groupby(["error", *_PAIR], as_index=False, sort=False)[_COUNTS].sum()
    parts = [pooled.assign(scenario=ALL)] if scenarios > 1 else []
    table = pd.concat([*parts, counts], ignore_index=True)[[*_KEY, *_COUNTS]]
    columns = ["draws", "wins", "wins_low", "wins_high", "p"]
    told = [_summary(*row) for row in table[_COUNTS].itertuples(index=False, name=None)]
    table = table.join(pd.DataFrame(told, columns=columns, index=table.index))
    return adjusted(table)


def _counted(
    first: pd.DataFrame, second: pd.DataFrame, metric: MetricDeclaration, draw: list[str]
) -> tuple[int, int, int]:
    pairs = paired_errors(first, second, metric)
    ahead = pairs[draw].assign(ahead=paired_advantages(pairs)).groupby(draw)["ahead"].sum()
    return int((ahead > 0).sum()), int((ahead == 0).sum()), int((ahead < 0).sum())


def _summary(won: int, even: int, lost: int) -> tuple[float, ...]:
    draws = won + even + lost
    share = share_interval(np.repeat([1.0, 0.5, 0.0], [won, even, lost]), np.arange(draws))
    p = permutation_p(np.repeat([1, -1], [won, lost]))
    return draws, share.estimate, share.low, share.high, p

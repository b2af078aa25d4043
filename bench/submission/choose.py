"""Choose the rows of a submission that are run again.

Each plugin's rows are a group, and those of all built-in estimators another one; in both, trials
that were skipped are a group of their own, as they enter no table. From each group so many rows
are drawn that forgers who changed ``SHARE`` of it are found with probability ``POWER``, whichever
rows they chose. Those that look most like forgeries are added.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.report.statistics.attempts import FLOOR, errors_of
from olne_bench.bench.submission.rows import Key, Rows

#: Forgers who changed this share of a group are found with this probability.
SHARE, POWER = 0.05, 0.97
#: Number of rows of a group that are added to the draw, those first that look most forged.
MOST_SUSPICIOUS = 12

_CELL = ["scenario", "sensor", "sigma"]
#: Logarithms of ratios are cut here: beyond, all are equally suspicious.
_MOST = 12.0


def needed(rows: int) -> int:
    """Least number of rows that finds ``SHARE`` of so many with probability ``POWER``."""
    forged = max(1, math.ceil(SHARE * rows))
    missed, drawn = 1.0, 0
    while missed > 1 - POWER:
        missed *= max(0, rows - forged - drawn) / (rows - drawn)
        drawn += 1
    return drawn


def choose(
    planned: Mapping[Key, Trial],
    rows: Rows,
    metric: MetricDeclaration | None,
    sample: int | None,
    rng: np.random.Generator,
) -> list[Trial]:
    """Trials to run again, in the order of ``planned``.

    From each group ``sample`` rows are drawn. Default: as many as are ``needed``.
    """
    suspicion = suspicions(rows.table, {t.plugin for t in planned.values()} - {""}, metric)
    skipped = rows.table["status"].eq("skipped").to_numpy()
    groups: dict[tuple[str, bool], list[Key]] = {}
    for key, trial in planned.items():
        group = (trial.plugin, bool(skipped[rows.places[key]]))
        groups.setdefault(group, []).append(key)
    chosen: set[Key] = set()
    for keys in groups.values():
        number = min(needed(len(keys)) if sample is None else sample, len(keys))
        drawn = {keys[k] for k in rng.choice(len(keys), number, replace=False)}
        others = [key for key in keys if key not in drawn]
        others.sort(key=lambda key: -suspicion[rows.places[key]])
        chosen |= drawn | set(others[: MOST_SUSPICIOUS if sample is None else number // 5])
    return [trial for key, trial in planned.items() if key in chosen]


def suspicions(
    table: pd.DataFrame, plugins: Iterable[str], metric: MetricDeclaration | None
) -> np.ndarray:
    """How much each row (R,) looks like a forgery.

    A row of a plugin is suspicious if its error is small beside others of its cell (scenario,
    sensor, noise level): its own, or those of the best rival, or beside the statistical limit. A
    rival's row is suspicious if its error is large, or if it failed. Each is a decimal logarithm.
    """
    if metric is None:
        return np.zeros(len(table))
    own = table["estimator"].isin([*plugins]).to_numpy()
    errors = errors_of(table, metric)
    log = pd.Series(_log(errors), index=table.index)
    cells = [table[name] for name in _CELL]
    usual = log.groupby([*cells, table["estimator"]]).transform("median")
    # Failures are common: they are not more suspicious than an error ten times as large.
    log = log.where(np.isfinite(errors), usual + 1)
    rival = usual.mask(own | table["estimator"].eq(FLOOR))
    best = rival.groupby(cells).transform("min").fillna(usual)
    small = np.maximum(usual - log, best - log)
    if {"cosine_error", "cosine_limit"} <= {*table}:
        limit = _log(table["cosine_limit"].to_numpy(float, na_value=np.nan))
        error = _log(errors_of(table, MetricDeclaration("cosine_error")))
        small = np.fmax(small, limit - error - 1)
    return np.where(own, small, log - usual)


def _log(values: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.asarray(np.clip(np.log10(values), -_MOST, _MOST))

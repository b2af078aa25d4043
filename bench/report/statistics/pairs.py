"""Trials in pairs, of two estimators or two runs: which error on the same observation is smaller.

Errors within a thousandth of each other tie, as do two failures. A failure loses to any error.
"""

from collections.abc import Iterator, Mapping
from functools import reduce

import numpy as np
import pandas as pd
from scipy.special import bdtr, gammaln

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.statistics import attempts
from olne_bench.bench.report.statistics.intervals import share_interval
from olne_bench.bench.report.study import FAILURES, USUAL, Study, compared, in_table

#: Comparisons with an adjusted p-value below this are significant.
SIGNIFICANCE = 0.05
#: Differences below these are ties: an absolute one, for rounding, and one relative to the smaller
#: error, for solvers that end at the same optimum.
_ROUNDING, _NEGLIGIBLE = 1e-12, 1e-3
#: Number of entries above which Fourier transforms are the faster convolution.
_LONG = 500
_GROUP = ["scenario", "sensor"]
_PAIR = ["scenario", "sensor", "sigma", "seed"]


def paired_errors(
    first: pd.DataFrame, second: pd.DataFrame, metric: MetricDeclaration
) -> pd.DataFrame:
    """Errors ``a`` and ``b`` of two tables of attempts for the trials that both have."""
    named = (("a", first), ("b", second))
    tables = [t[_PAIR].assign(**{name: attempts.errors_of(t, metric)}) for name, t in named]
    return tables[0].merge(tables[1], on=_PAIR)


def compare_pairs(pairs: pd.DataFrame, family: bool) -> dict[str, float]:
    """Compare ``paired_errors`` of one scenario: ``pairs, units, wins, wins_low, wins_high, p``.

    In a family the trials of a seed share one draw.
    """
    advantage = paired_advantages(pairs)
    units = pd.factorize(pairs["seed"])[0] if family else np.arange(len(pairs))
    wins = share_interval((1 + advantage) / 2, units)
    p = permutation_p(np.bincount(units, advantage).astype(int))
    return {"pairs": len(pairs), "units": len(np.unique(units)), **wins.columns("wins"), "p": p}


def paired_advantages(pairs: pd.DataFrame) -> np.ndarray:
    """Which error of ``paired_errors`` is smaller: 1 if ``a`` is, -1 if ``b`` is, 0 for a tie."""
    a, b = pairs["a"].to_numpy(), pairs["b"].to_numpy()
    with np.errstate(invalid="ignore"):  # two failures
        tie = (a == b) | (np.abs(a - b) <= _ROUNDING + _NEGLIGIBLE * np.minimum(a, b))
    return np.where(tie, 0, np.where(a < b, 1, -1))


def permutation_p(advantages: np.ndarray) -> float:
    """Exact two-sided p-value of a sum of whole numbers with either sign with equal chance."""
    sizes, numbers = np.unique(np.abs(advantages[advantages != 0]), return_counts=True)
    if not len(sizes):
        return 1.0
    sizes = sizes // np.gcd.reduce(advantages)
    total, far = int(sizes @ numbers), abs(int(advantages.sum())) // np.gcd.reduce(advantages)
    if len(sizes) == 1:
        return min(1.0, 2 * float(bdtr((total - far) // 2, total, 0.5)))
    # Units of the same size differ by their number of plus signs only.
    parts = []
    for size, number in zip(sizes, numbers, strict=True):
        parts.append(np.zeros(size * number + 1))
        parts[-1][::size] = _heads(number)
    while len(parts) > 1:  # equal lengths are fastest
        parts = [reduce(_convolved, parts[k : k + 2]) for k in range(0, len(parts), 2)]
    tail = float(parts[0][: (total - far) // 2 + 1].sum())
    # Fourier transforms may round below the least possible chance, even below zero.
    return float(np.clip(2 * tail, 2.0 ** (1 - numbers.sum()), 1.0))


def _heads(number: int) -> np.ndarray:
    """Chance of each number of heads, 0 to ``number``, in ``number`` throws of a coin."""
    heads = np.arange(number + 1)
    ways = gammaln(number + 1) - gammaln(heads + 1) - gammaln(number - heads + 1)
    return np.asarray(np.exp(ways - number * np.log(2)))


def _convolved(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The convolution, by Fourier transforms if it is long (scipy.signal is slow to import)."""
    if min(len(one), len(other)) < _LONG:
        return np.convolve(one, other)
    size = len(one) + len(other) - 1
    return np.fft.irfft(np.fft.rfft(one, size) * np.fft.rfft(other, size), size)


def holm(p: np.ndarray) -> np.ndarray:
    """P-values adjusted for their number (Holm 1979), over all errors of the table."""
    order = np.argsort(p, kind="stable")
    factors = len(p) - np.arange(len(p))
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(p[order] * factors))
    return adjusted


def compare_runs(
    before: pd.DataFrame, after: pd.DataFrame, names: Mapping[str, str], study: Study = USUAL
) -> pd.DataFrame:
    """Compare estimators of two runs in every scenario and sensor that both have.

    ``names`` are labels in ``before`` and in ``after``, which may be the same run. Trials without
    noise count only if they are of a family's draws. Columns: ``error`` (a compared metric, or
    ``failures``), ``scenario, sensor, estimator, other, pairs``; medians ``before, after`` over the
    pairs, or shares of failures; ``ratio``, the geometric mean of error after over before where
    neither failed; ``better``, the share of pairs that improved, a tie counting half, with
    ``better_low, better_high`` (95 %); ``p, p_holm``; ``verdict``: better, worse or same.
    """
    columns = ["error", *_GROUP, "estimator", "other", "pairs", "before", "after", "ratio"]
    columns += ["better", "better_low", "better_high", "p"]
    metrics = in_table(in_table(compared(study.metrics), before), after)
    rows = [r for m in (*metrics, FAILURES) for r in _changes((before, after), names, m, study)]
    table = pd.DataFrame(rows, columns=columns)
    table["p_holm"] = holm(table["p"].to_numpy(float))
    told = table["p_holm"] < SIGNIFICANCE
    changed = [told & (table["better"] > 0.5), told & (table["better"] < 0.5)]
    table["verdict"] = np.select(changed, ["better", "worse"], "same")
    return table


def _changes(
    runs: tuple[pd.DataFrame, pd.DataFrame],
    names: Mapping[str, str],
    metric: MetricDeclaration,
    study: Study,
) -> Iterator[dict[str, object]]:
    """Changes of the estimators by one metric, a row per estimator, scenario and sensor."""
    before, after = (attempts.noisy(attempts.attempts_of(trials), study) for trials in runs)
    before, after = (t[attempts.measured(t, metric, study)] for t in (before, after))
    middle = np.mean if metric == FAILURES else attempts.median
    for old, new in names.items():
        first, second = before[before["estimator"] == old], after[after["estimator"] == new]
        pairs = paired_errors(second, first, metric)
        for (scenario, sensor), group in pairs.groupby(_GROUP, sort=True):
            labels = {"error": metric.name, "scenario": scenario, "sensor": sensor}
            labels |= {"estimator": old, "other": new}
            last, now = (float(middle(group[name].to_numpy())) for name in ("b", "a"))
            found = compare_pairs(group, study.is_family(str(scenario)))
            better = {name.replace("wins", "better"): value for name, value in found.items()}
            ratio = _ratio(group, metric)
            yield labels | better | {"before": last, "after": now, "ratio": ratio}


def _ratio(pairs: pd.DataFrame, metric: MetricDeclaration) -> float:
    """Geometric mean of the ratio of errors; NaN for failures, and where all failed."""
    both = pairs.loc[np.isfinite(pairs["a"]) & np.isfinite(pairs["b"]), ["a", "b"]]
    if both.empty or metric == FAILURES:
        return float("nan")
    logs = np.log(np.maximum(both, metric.negligible))
    return float(np.exp((logs["a"] - logs["b"]).mean()))

"""Trials in pairs: which of two errors on the same observation is the smaller one.

Every estimator sees the same noise, so two are compared trial by trial: which one has the smaller
error, whatever the difference. Errors within a thousandth of each other are a tie. A failure loses
to any error, and two failures are a tie.
"""

from functools import reduce

import numpy as np
import pandas as pd
from scipy.special import bdtr, gammaln

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.statistics.attempts import errors_of
from olne_bench.bench.report.statistics.intervals import share_interval

#: Comparisons with an adjusted p-value below this are significant.
SIGNIFICANCE = 0.05
#: Differences below these are ties: an absolute one, for rounding, and one relative to the smaller
#: error, for solvers that end at the same optimum.
_ROUNDING, _NEGLIGIBLE = 1e-12, 1e-3
#: Number of entries above which Fourier transforms are the faster convolution.
_LONG = 500
_PAIR = ["scenario", "sensor", "sigma", "seed"]


def adjusted(table: pd.DataFrame) -> pd.DataFrame:
    """A table with ``p_holm``, its column ``p`` adjusted after Holm for all its rows."""
    return table.assign(p_holm=holm(table["p"].to_numpy(float)))


def paired_errors(
    first: pd.DataFrame, second: pd.DataFrame, metric: MetricDeclaration
) -> pd.DataFrame:
    """Errors ``a`` and ``b`` of two tables of attempts for the trials that both have."""
    named = (("a", first), ("b", second))
    tables = [t[_PAIR].assign(**{name: errors_of(t, metric)}) for name, t in named]
    return tables[0].merge(tables[1], on=_PAIR)


def compare_pairs(pairs: pd.DataFrame, family: bool) -> dict[str, float]:
    """Compare ``paired_errors``: ``pairs, units, wins, wins_low, wins_high, p``.

    Args:
        pairs: ``paired_errors`` of one scenario.
        family: whether the scenario is a family, so that the trials of a seed share one draw.
    """
    advantage = paired_advantages(pairs)
    units = pd.factorize(pairs["seed"])[0] if family else np.arange(len(pairs))
    wins = share_interval((1 + advantage) / 2, units)
    return {
        "pairs": len(pairs),
        "units": len(np.unique(units)),
        "wins": wins.estimate,
        "wins_low": wins.low,
        "wins_high": wins.high,
        "p": permutation_p(np.bincount(units, advantage).astype(int)),
    }


def paired_advantages(pairs: pd.DataFrame) -> np.ndarray:
    """Which error of ``paired_errors`` is smaller: 1 if ``a`` is, -1 if ``b`` is, 0 for a tie."""
    a, b = pairs["a"].to_numpy(), pairs["b"].to_numpy()
    with np.errstate(invalid="ignore"):  # two failures
        tie = (a == b) | (np.abs(a - b) <= _ROUNDING + _NEGLIGIBLE * np.minimum(a, b))
    return np.where(tie, 0, np.where(a < b, 1, -1))


def permutation_p(advantages: np.ndarray) -> float:
    """Exact two-sided p-value of a sum whose terms have either sign with equal chance.

    Args:
        advantages: whole numbers, one for each independent unit.

    Returns:
        Share of all sign patterns whose sum is at least as far from zero; 1 if all are ties.
    """
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
    chances: np.ndarray = np.exp(ways - number * np.log(2))
    return chances


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
    adjusted = np.minimum(1.0, np.maximum.accumulate(p[order] * factors))
    result = np.empty(len(p))
    result[order] = adjusted
    return result

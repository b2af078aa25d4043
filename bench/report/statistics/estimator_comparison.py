"""Comparison of estimators on the same observations.

Every estimator sees the same noise, so two are compared trial by trial: which one has the smaller
error, whatever the difference. Errors within a thousandth of each other are a tie. A failure loses
to any error, and two failures are a tie.
"""

from collections.abc import Iterator
from functools import reduce
from itertools import combinations

import numpy as np
import pandas as pd
from scipy.special import bdtr, gammaln

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.measures import compared, in_table
from olne_bench.bench.report.statistics.attempts import (
    FLOOR,
    attempts_of,
    errors_of,
    measured,
    noisy,
)
from olne_bench.bench.report.statistics.intervals import share_interval
from olne_bench.bench.report.study import USUAL, Study

#: Comparisons with an adjusted p-value below this are significant.
SIGNIFICANCE = 0.05
#: With fewer independent units no p-value can be that small: 2 / 2**5 is larger.
_LEAST_UNITS = 6
#: An estimator with less than this share of the largest number of trials was run on a part of them.
_WHOLE = 0.8
#: It is ranked all the same if it has this share, and so many independent units with another one.
_LARGE_PART, _ENOUGH_UNITS = 0.4, 20
#: Differences below these are ties: an absolute one, for rounding, and one relative to the smaller
#: error, for solvers that end at the same optimum.
_ROUNDING, _NEGLIGIBLE = 1e-12, 1e-3
#: Number of entries above which Fourier transforms are the faster convolution.
_LONG = 500
_GROUP = ["scenario", "sensor"]
_PAIR = [*_GROUP, "sigma", "seed"]
#: Columns of trials that comparisons need besides those of metrics.
NEEDED = (*_PAIR, "estimator", "status", "count")


def compare_estimators(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """Compare all pairs of estimators by each compared metric, in every scenario and sensor.

    Rows without noise are not random and do not count, unless they are of a family's draws.

    Returns:
        Columns ``error, scenario, sensor, estimator, other``, ``pairs`` (trials that both have
        attempted), ``units`` (how many of them are independent: in a family, its draws), ``wins``
        (share in which ``estimator`` has the smaller error, a tie counting half) with ``wins_low``
        and ``wins_high`` (95 %), ``p`` of a permutation test and ``p_holm``, adjusted after Holm
        for all comparisons of the table, by all metrics.
    """
    return adjusted(comparison_rows(trials, study))


def comparison_rows(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """The rows of ``compare_estimators`` without ``p_holm``, which needs those of all scenarios."""
    metrics = in_table(compared(study.metrics), trials)
    attempts = noisy(attempts_of(trials[[*NEEDED, *(metric.name for metric in metrics)]]), study)
    columns = ["error", *_GROUP, "estimator", "other", "pairs", "units"]
    columns += ["wins", "wins_low", "wins_high", "p"]
    rows = [row for metric in metrics for row in _compare(attempts, metric, study)]
    return pd.DataFrame(rows, columns=columns)


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


def significant_wins(comparisons: pd.DataFrame, error: str) -> pd.DataFrame:
    """Columns ``scenario, sensor, winner, loser`` of the significant comparisons by an error."""
    told = comparisons[(comparisons["error"] == error) & (comparisons["p_holm"] < SIGNIFICANCE)]
    loses = told["wins"] < 0.5
    return told[_GROUP].assign(
        winner=told["other"].where(loses, told["estimator"]),
        loser=told["estimator"].where(loses, told["other"]),
    )


def ranks(comparisons: pd.DataFrame, estimators: pd.DataFrame, error: str) -> pd.Series:
    """Rank of each estimator: one more than the number of contenders significantly better.

    The floor is no contender. Its own rank says where it would be. Nor is an estimator that was run
    on a small part of the trials: it has no rank.

    Args:
        comparisons: from ``compare_estimators``.
        estimators: rows with ``scenario, sensor, estimator`` and their number of ``trials``.
        error: name of the error to rank by.

    Returns:
        Ranks with the index of ``estimators``; estimators without a significant difference share
        one. A rank is missing if there is no other estimator, if there are too few independent
        units for any significant difference, and for estimators that were run on less than 80 % of
        the trials, unless these are 40 % and 20 independent units: fewer would hide their losses.
    """
    of_error = comparisons[comparisons["error"] == error]
    keys = pd.MultiIndex.from_frame(estimators[[*_GROUP, "estimator"]])
    most = estimators.groupby(_GROUP)["trials"].transform("max")
    share = estimators["trials"] / most
    whole = (share >= _WHOLE) & keys.isin(_compared_on(of_error, _LEAST_UNITS))
    ranked = whole | ((share >= _LARGE_PART) & keys.isin(_compared_on(of_error, _ENOUGH_UNITS)))
    contenders = keys[ranked & (estimators["estimator"] != FLOOR)]
    told = significant_wins(of_error, error)
    told = told[pd.MultiIndex.from_frame(told[[*_GROUP, "winner"]]).isin(contenders)]
    beaten = told.groupby([*_GROUP, "loser"]).size()
    found = pd.Series(1 + beaten.reindex(keys, fill_value=0).to_numpy(int), estimators.index)
    return found.astype("Int64").where(ranked)


def _compared_on(comparisons: pd.DataFrame, units: int) -> pd.MultiIndex:
    """Scenario, sensor and estimator of those that some comparison has so many units of."""
    enough = comparisons[comparisons["units"] >= units]
    both = pd.concat([enough, enough.assign(estimator=enough["other"])])
    return pd.MultiIndex.from_frame(both[[*_GROUP, "estimator"]])


def leaders(table: pd.DataFrame, error: str) -> pd.Series:
    """Which rows of a leaderboard to show as the best by an error.

    These are the rows of rank 1 with a finite median, except the floor, if some estimator is
    significantly worse.
    """
    ranked = table[f"{error}_rank"]
    told = ranked.gt(1).fillna(False).groupby([table[name] for name in _GROUP]).transform("any")
    first = ranked.eq(1).fillna(False) & told & np.isfinite(table[f"{error}_median"])
    return (first & (table["estimator"] != FLOOR)).astype(bool)


def _compare(
    attempts: pd.DataFrame, metric: MetricDeclaration, study: Study
) -> Iterator[dict[str, object]]:
    attempts = attempts[measured(attempts, metric, study)]
    for (scenario, sensor), rows in attempts.groupby(_GROUP, sort=True):
        parts = dict(list(rows.groupby("estimator", sort=True)))
        family = study.is_family(str(scenario))
        for first, second in combinations(parts, 2):
            pairs = paired_errors(parts[first], parts[second], metric)
            labels = {"error": metric.name, "scenario": scenario, "sensor": sensor}
            yield labels | {"estimator": first, "other": second} | compare_pairs(pairs, family)

"""Confidence intervals of means and shares of trials that are not all independent."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import bdtr, ndtri, stdtrit

CONFIDENCE = 0.95
#: With fewer seeds, the spread between seeds is too uncertain for an honest interval.
LEAST_SEEDS_OF_MEANS, LEAST_SEEDS_OF_SHARES = 6, 5
#: Share of the bootstrap on either side of the interval. It is less than (1 - CONFIDENCE) / 2, as
#: few seeds cover too little of the tail. Simulated intervals then hold the truth in 90 to 99 %.
_TAIL = 0.015
_RESAMPLES = 4000
_BLOCK = 500_000  # numbers drawn at once
_LEAST_ERROR = 1e-9  # as a share of the standard error; smaller ones are rounding
#: With fewer values, no two of them enclose the median with ``CONFIDENCE``.
LEAST_VALUES_OF_MEDIANS = 6


@dataclass(frozen=True)
class Interval:
    """An estimate with its confidence interval; NaN where there are too few data."""

    estimate: float
    low: float = np.nan
    high: float = np.nan

    def columns(self, name: str, middle: str = "") -> dict[str, float]:
        """Columns ``{name}``, or ``{name}_{middle}``, and ``{name}_low`` and ``{name}_high``."""
        estimate = f"{name}_{middle}" if middle else name
        return {estimate: self.estimate, f"{name}_low": self.low, f"{name}_high": self.high}


def mean_by_seed(values: np.ndarray, seeds: np.ndarray, count: np.ndarray) -> Interval:
    """Mean of errors (R,) with a studentised bootstrap interval that resamples seeds.

    This accounts for skewed errors (Efron and Tibshirani 1993, ch. 12), at least 0. A seed's trials
    are kept together, as they may share one draw. A row stands for ``count`` (R,) trials: more than
    one means one of each seed. No interval if the mean is infinite.
    """
    if not len(values):
        return Interval(np.nan)
    sums, sizes = _by_seed(values, seeds, count)
    number = len(sums)
    estimate = float(sums.sum() / sizes.sum())
    if number < LEAST_SEEDS_OF_MEANS or not np.isfinite(estimate):
        return Interval(estimate)
    error = float(_standard_error(sums, sizes))
    rng = np.random.default_rng(0)
    deviations, errors = np.empty(_RESAMPLES), np.empty(_RESAMPLES)
    block = max(1, _BLOCK // number)
    for start in range(0, _RESAMPLES, block):
        part = slice(start, min(start + block, _RESAMPLES))
        chosen = rng.integers(number, size=(part.stop - start, number))
        drawn_sums, drawn_sizes = sums[chosen], sizes[chosen]
        deviations[part] = drawn_sums.sum(axis=1) / drawn_sizes.sum(axis=1) - estimate
        errors[part] = _standard_error(drawn_sums, drawn_sizes)
    usable = errors > _LEAST_ERROR * error  # the same seed drawn each time has no spread
    if not usable.any():
        return Interval(estimate, estimate, estimate)
    studentised = deviations[usable] / errors[usable]
    low, high = np.quantile(studentised, [_TAIL, 1 - _TAIL])
    return Interval(estimate, max(0.0, estimate - high * error), float(estimate - low * error))


def median_interval(values: np.ndarray) -> Interval:
    """Median of independent values, between two that enclose it with at least ``CONFIDENCE``.

    The number of values below the true median is binomial. Infinite values rank last.
    """
    ordered, number = np.sort(values), len(values)
    if not number:
        return Interval(np.nan)
    low, high = ordered[(number - 1) // 2], ordered[number // 2]
    middle = float(low if low == high else (low + high) / 2)
    if number < LEAST_VALUES_OF_MEDIANS:
        return Interval(middle)
    outside = int((bdtr(np.arange(number), number, 0.5) <= (1 - CONFIDENCE) / 2).sum())
    return Interval(middle, float(ordered[outside - 1]), float(ordered[number - outside]))


def share_interval(values: np.ndarray, units: np.ndarray) -> Interval:
    """Share of values (R,) from 0 to 1, with Wilson's interval at the effective number of trials.

    That many independent trials would have the variance seen between ``units`` (R,) (Korn and
    Graubard 1998): at least one per unit, at most R. As few units give an uncertain variance, one
    unit whose trials are all alike is added to them.
    """
    if not len(values):
        return Interval(np.nan)
    sums, sizes = _by_seed(values, units, np.ones(len(values), int))
    share, number = float(values.mean()), len(sums)
    if number < LEAST_SEEDS_OF_SHARES:
        return Interval(share)
    binomial = share * (1 - share)
    seen = float(_standard_error(sums, sizes)) ** 2
    variance = ((number - 1) * seen + binomial / number) / number
    effective = binomial / variance if variance > 0 else float(number)
    z, student = float(ndtri((1 + CONFIDENCE) / 2)), stdtrit(number, (1 + CONFIDENCE) / 2)
    effective = float(np.clip(min(effective, len(values)) * (z / student) ** 2, number, None))
    centre = (share + z**2 / (2 * effective)) / (1 + z**2 / effective)
    reach = z * np.sqrt(binomial / effective + z**2 / (4 * effective**2)) / (1 + z**2 / effective)
    # Rounding must not put a share of 0 or 1 outside its own interval.
    low, high = min(share, centre - reach), max(share, centre + reach)
    return Interval(share, max(0.0, low), min(1.0, high))


def _by_seed(
    values: np.ndarray, seeds: np.ndarray, count: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sum of the values and number of trials of every seed."""
    single = count == 1
    codes, labels = pd.factorize(seeds[single], sort=True)
    number = len(labels) or int(count.max())
    sums = np.bincount(codes, values[single], minlength=number)
    sizes = np.bincount(codes, minlength=number)
    shared, each = values[~single], count[~single] / number
    return sums + (shared * each).sum(), sizes + each.sum()


def _standard_error(sums: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Standard error of the ratio of totals, by linearisation; seeds along the last axis."""
    number = sums.shape[-1]
    totals = sizes.sum(axis=-1, keepdims=True)
    residuals = sums - sums.sum(axis=-1, keepdims=True) / totals * sizes
    variance = number / (number - 1) * (residuals**2).sum(axis=-1) / totals[..., 0] ** 2
    return np.asarray(np.sqrt(variance))

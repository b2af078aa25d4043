"""Rolling median and quartiles that count failures."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view


@dataclass(frozen=True)
class RollingStatistics:
    """Statistics of W windows of consecutive points.

    Attributes:
        x: (W,) mean abscissa.
        lower: (W,) first quartile of the ordinate.
        median: (W,) its median.
        upper: (W,) its third quartile.
    """

    x: np.ndarray
    lower: np.ndarray
    median: np.ndarray
    upper: np.ndarray


def rolling_statistics(
    x: np.ndarray, y: np.ndarray, count: np.ndarray, window: int, most: int | None = None
) -> RollingStatistics:
    """Median and quartiles over a window of points ordered by x.

    Quantiles are order statistics, the higher one of two: a value that occurred, never the mean of
    a number and a failure.

    Args:
        x: (P,) abscissae.
        y: (P,) ordinates; a failure is infinite, hence worse than all others.
        count: (P,) how often each point occurs.
        window: points per window. Fewer points than that give no statistics (W = 0).
        most: largest number of windows, which are then evenly selected. Default: all.
    """
    order = np.argsort(x, kind="stable")
    x, y = (np.repeat(values[order], count[order]) for values in (x, y))
    if len(x) < window:
        empty = np.empty(0)
        return RollingStatistics(empty, empty, empty, empty)
    windows, places = sliding_window_view(y, window), sliding_window_view(x, window)
    if most is not None and len(windows) > most:
        chosen = np.linspace(0, len(windows) - 1, most).round().astype(int)
        windows, places = windows[chosen], places[chosen]
    lower, median, upper = np.quantile(windows, (0.25, 0.5, 0.75), axis=1, method="higher")
    return RollingStatistics(places.mean(axis=1), lower, median, upper)

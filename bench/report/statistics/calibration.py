"""Calibration: whether regions and intervals hold the truth as often as they claim.

Levels are those of the smallest region that holds the truth (``credible_level``), of each true
weight in its distribution (``weight_levels``), and the share of samples that is closer to a random
point than the truth (``tarp_level``). All are uniform between 0 and 1 if estimates are calibrated.
"""

import numpy as np
import pandas as pd
import scipy

from olne_bench.bench.report.statistics.identifiability import flat_numbers
from olne_bench.bench.report.statistics.intervals import share_interval
from olne_bench.bench.report.statistics.pairs import holm

LEVEL, TARP, WEIGHTS = "credible_level", "tarp_level", "weight_levels"
WIDTH = "region_width"
#: Levels of the table.
NOMINAL = (0.5, 0.8, 0.95)
#: Level of the regions of ``width_table``.
_REGION = 0.95
_WIDTH_COLUMNS = ["trials", "covered", "covered_low", "covered_high", "width"]
_COLUMNS = ["scenario", "sensor", "estimator", "sigma", "trials", "p_uniform"]


def calibration_table(trials: pd.DataFrame) -> pd.DataFrame:
    """How often regions and intervals of several levels hold the truth, where there are any.

    Columns: ``scenario, sensor, estimator, sigma, trials``; ``p_uniform``, the chance of levels as
    uneven as these if all were calibrated (Kolmogorov and Smirnov); the share ``covered_50`` and so
    on, with its 95 % interval ``_low, _high``; ``weights_50`` and so on, the same of single weights
    in central intervals; ``p_weights``, the smallest chance of a weight's levels, adjusted after
    Holm; ``p_tarp``, that of TARP; ``width``, the regions' median, as a standard deviation of
    weights. Those after ``covered`` are left out where no region tells them.
    """
    if LEVEL not in trials:
        return pd.DataFrame(columns=_COLUMNS)
    told = trials[trials[LEVEL].notna() & (trials["status"] == "ok")]
    rows = [
        dict(zip(_COLUMNS, (*place, len(group)), strict=False)) | _of_cell(group)
        for place, group in told.groupby(_COLUMNS[:4], sort=True)
    ]
    return pd.DataFrame(rows) if rows else pd.DataFrame(columns=_COLUMNS)


def width_table(trials: pd.DataFrame) -> pd.DataFrame:
    """How often 95 % regions hold the truth, and how wide they are, if they have a width.

    Columns: ``scenario, sensor, estimator, sigma, trials``; the share ``covered``, and its exact
    95 % interval ``covered_low, covered_high`` (Clopper and Pearson: one trial per seed, so they
    are independent); the median ``width``, as a standard deviation of weights.
    """
    place = _COLUMNS[:4]
    if LEVEL not in trials or WIDTH not in trials:
        return pd.DataFrame(columns=[*place, *_WIDTH_COLUMNS])
    told = trials[trials[LEVEL].notna() & trials[WIDTH].notna() & (trials["status"] == "ok")]
    rows = []
    for key, group in told.groupby(place, sort=True):
        inside = int((group[LEVEL] <= _REGION).sum())
        bounds = scipy.stats.binomtest(inside, len(group)).proportion_ci(0.95, method="exact")
        shares = inside / len(group), bounds.low, bounds.high
        rows.append((*key, len(group), *shares, float(group[WIDTH].median())))
    return pd.DataFrame(rows, columns=[*place, *_WIDTH_COLUMNS])


def weight_levels_of(group: pd.DataFrame) -> np.ndarray:
    """The levels (R, N, K) of weights in trials that tell them; NaN of players a trial lacks."""
    if WEIGHTS not in group or not group[WEIGHTS].notna().any():
        return np.empty((0, 0, 0))
    column = group[WEIGHTS].dropna()
    numbers, players = flat_numbers(column)
    levels = np.full((len(players), players.max(), len(numbers) // players.sum()), np.nan)
    levels[np.arange(players.max()) < players[:, None]] = numbers.reshape(players.sum(), -1)
    return levels


def _of_cell(group: pd.DataFrame) -> dict[str, float]:
    levels, units = group[LEVEL].to_numpy(float), group["seed"].to_numpy()
    found = {"p_uniform": _uneven(levels)}
    for nominal in NOMINAL:
        found |= _share("covered", nominal, levels <= nominal, units)
    weights = weight_levels_of(group)
    if weights.size:
        weights = weights.reshape(len(weights), -1)
        told, seeds = np.isfinite(weights), group.loc[group[WEIGHTS].notna(), "seed"].to_numpy()
        units = np.broadcast_to(seeds[:, None], told.shape)[told]
        for nominal in NOMINAL:
            inside = np.abs(weights[told] - 0.5) <= nominal / 2
            found |= _share("weights", nominal, inside, units)
        p = np.array([_uneven(column[np.isfinite(column)]) for column in weights.T])
        found["p_weights"] = float(holm(p).min())
    if TARP in group and group[TARP].notna().any():
        found["p_tarp"] = _uneven(group[TARP].dropna().to_numpy(float))
    if WIDTH in group and group[WIDTH].notna().any():
        found["width"] = float(group[WIDTH].median())
    return found


def _share(name: str, nominal: float, inside: np.ndarray, units: np.ndarray) -> dict[str, float]:
    share = share_interval(inside.astype(float), units)
    return share.columns(f"{name}_{100 * nominal:.0f}")


def _uneven(levels: np.ndarray) -> float:
    return float(scipy.stats.kstest(levels, "uniform").pvalue)


def coverage_curve(levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nominal level and share of trials covered, as steps from (0, 0) to (1, 1)."""
    ordered = np.sort(levels)
    shares = np.arange(1, len(ordered) + 1) / len(ordered)
    return np.concatenate([[0.0], ordered, [1.0]]), np.concatenate([[0.0], shares, [1.0]])

"""Regions of predicted positions that hold whatever drives: calibrated on other draws.

Split conformal prediction (Vovk et al. 2005; Lei et al. 2018): of n draws of the same traffic, the
k-th smallest distance of the worst predicted car, k = ceil(0.9 (n + 1)), is the radius of discs
around predicted positions that hold all cars of a further draw with a chance of at least 90 %. No
model has to be true for it; draws have to be exchangeable. A failure is infinitely far away.
"""

import math

import numpy as np
import pandas as pd

from olne_bench.bench.report.statistics.attempts import attempts_of, errors_of, measured
from olne_bench.bench.report.statistics.damage import worlds
from olne_bench.bench.report.study import Study, in_table

#: Share of draws whose cars the discs have to hold.
LEVEL = 0.9
#: Fewest draws of which one half can calibrate the other: k of them must exist.
FEWEST = 18
_HALVES = 200
_CELL = ["scenario", "sensor", "sigma", "estimator", "error"]
_COLUMNS = [*_CELL, "draws", "radius", "held", "radius_as_told", "held_as_told"]


def distances(trials: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Of each attempt ``scenario, sensor, sigma, estimator, error, seed, distance`` [m].

    ``error`` is a metric that declares a ``radius``.
    """
    tried = attempts_of(trials)
    parts = [pd.DataFrame(columns=[*_CELL, "seed", "distance"])]
    for metric in in_table([one for one in study.metrics if one.radius], tried):
        about = tried[measured(tried, metric, study)]
        labels = about[["scenario", "sensor", "sigma", "estimator", "seed"]]
        parts.append(labels.assign(error=metric.name, distance=errors_of(about, metric)))
    return pd.concat(parts[1:] or parts, ignore_index=True)


def conformal_table(far: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Radii of regions of predicted positions, and how often they hold, from ``distances``.

    Columns: ``scenario, sensor, sigma, estimator, error``; ``draws``; ``radius`` [m], calibrated on
    all draws; ``held``, share of draws in one half that the radius of the other half holds, mean
    over halves; ``radius_as_told`` and ``held_as_told``, by draws of the same world as estimators
    are told (``damage_table``), NaN where there is none.
    """
    told = worlds(study).set_index("scenario")
    true = told[told["change"] == ""].reset_index().drop_duplicates("world").set_index("world")
    cells = {key: own["distance"].to_numpy(float) for key, own in far.groupby(_CELL)}
    rows = []
    for (scenario, *place), own in cells.items():
        if len(own) < FEWEST:
            continue
        world = told["world"].get(scenario)
        as_told = cells.get((true["scenario"].get(world), *place))
        numbers = len(own), _radius(own), _held(own), *_of_others(own, as_told)
        rows.append((scenario, *place, *numbers))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _radius(distances: np.ndarray) -> float:
    """The radius that distances (n,) of other draws calibrate; infinite for too few of them."""
    place = math.ceil(LEVEL * (len(distances) + 1))
    return float(np.sort(distances)[place - 1]) if place <= len(distances) else math.inf


def _held(distances: np.ndarray) -> float:
    """Share of draws that the radius of others holds, mean over random halves."""
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(_HALVES):
        one, other = np.array_split(rng.permutation(distances), 2)
        shares.append(float((other <= _radius(one)).mean()))
    return float(np.mean(shares))


def _of_others(distances: np.ndarray, others: np.ndarray | None) -> tuple[float, float]:
    """The radius that another world's draws calibrate, and the share of these that it holds."""
    if others is None or len(others) < FEWEST:
        return math.nan, math.nan
    radius = _radius(others)
    return radius, float((distances <= radius).mean())

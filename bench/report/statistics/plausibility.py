"""Rows whose error is far below what their observation allows: who made them knew the truth.

Given the data, the truth lies around any estimate as its posterior says, or farther away. Near the
truth the posterior is normal, with the precision of the data's Fisher information and the prior's.
So a squared distance of estimate and truth is at least that of the posterior's mean, a weighted sum
of squared normal numbers, one for each free weight, whatever an honest estimator does. Two count,
in the precision of the posterior and of plain weights, as a known truth may have noise in the
directions that show; each row by row, and for all rows of a scenario, sensor and noise level.

Estimators of this package, whose code is known, and plugged-in scenarios and sensors, which may
tell any truth, are judged by a row's columns alone. Without noise and on published weights, an
exact estimate is no wonder, and nothing is judged.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from olne_bench.bench.judge.scene import NoSceneError, TrueScene
from olne_bench.bench.plan.trial import foreign_worlds
from olne_bench.bench.report.statistics.attempts import places_of, which
from olne_bench.bench.report.statistics.identifiability import weights_of
from olne_bench.bench.report.study import Study
from olne_bench.games.model.simplex import simplex_tangent, theta_tangent

#: Chance that a row, or a cell, of an efficient estimator is marked.
LEVEL = 1e-6
#: Draws of a family whose truths are looked at. What all rows say chooses them, so no estimator can
#: tell which.
MOST_DRAWS = 10

#: The posterior may be this much more precise than its approximation, in terms of variance. In
#: honest cells the mean squared distance is at least 0.4 of what is expected, where few directions
#: count, and 0.6 where many do (scripts/stored_rows.py plausible).
_SAFETY = 2.0
#: By columns, all of an error may come from one direction: its chance to be r times smaller than
#: expected is that of a single normal number. Of expected errors these count at most: a cosine
#: error, whose prior is seldom narrower, and a position error over sigma, the least that efficient
#: estimators have on roads.
_MOST_COSINE, _MOST_POSITION = 0.01, 0.05
#: Chance of a position error so small, and of a cosine error, which need not be seen in the motion.
_POSITION_LEVEL, _COSINE_LEVEL = LEVEL, 1e-4
_COSINE_ROUNDING = 4e-16
_CELL = ["scenario", "sensor"]
_LEVEL_KEY = ["estimator", "sigma"]


@dataclass(frozen=True)
class Distances:
    """Squared distances of an estimate from the truth."""

    whitened: float  # in the precision of the posterior; the number of free weights is expected
    plain: float  # of weights, mostly of those that show least; the sum of ``scales`` is expected
    scales: np.ndarray  # variances of the posterior in its principal directions


def implausible(trials: pd.DataFrame, study: Study) -> np.ndarray:
    """Which rows of ``trials.parquet`` are implausible, (rows,) bool."""
    marked = np.zeros(len(trials), bool)
    judged = (trials["sigma"] > 0) & which(trials["scenario"], study.has_drawn_truths)
    judged &= trials["status"].isin(["ok", "failed_forward"])
    places = np.flatnonzero(judged.to_numpy(bool))
    rows = trials.iloc[places]
    marked[places] = _exact(rows)
    if "weights" not in trials:
        return marked
    told = (which(rows["estimator"], study.is_foreign) & rows["weights"].notna()).to_numpy(bool)
    places, rows = places[told], rows[told]
    for (scenario, sensor), numbers in places_of(rows, _CELL).items():
        found = _too_near(rows.iloc[numbers], str(scenario), str(sensor), study)
        marked[places[numbers]] |= found
    return marked


def _exact(rows: pd.DataFrame) -> np.ndarray:
    """Which rows have weights and a motion that are known exactly, as their columns say."""
    if not {"position_error", "cosine_error"} <= {*rows.columns}:
        return np.zeros(len(rows), bool)
    limit = np.full(len(rows), _MOST_COSINE)
    if "cosine_limit" in rows:
        limit = np.fmin(limit, rows["cosine_limit"].to_numpy(float, na_value=np.nan))
    cosine = rows["cosine_error"].to_numpy(float, na_value=np.nan)
    position = rows["position_error"].to_numpy(float, na_value=np.nan)
    known = cosine <= np.maximum(limit * _quantile(_COSINE_LEVEL), _COSINE_ROUNDING)
    least = _MOST_POSITION * rows["sigma"].to_numpy(float) * np.sqrt(_quantile(_POSITION_LEVEL))
    return np.asarray(known & (position < least))


def _quantile(level: float) -> float:
    """Quantile of chi-squared with one degree of freedom, at a small level."""
    return float(np.pi / 2 * level**2)


def _too_near(rows: pd.DataFrame, scenario: str, sensor: str, study: Study) -> np.ndarray:
    """Which rows of a scenario and sensor are nearer to the truth than their data allow."""
    found = np.zeros(len(rows), bool)
    distances = distances_of(rows, scenario, sensor, study)
    for k, own in enumerate(distances):
        found[k] = own is not None and _is_too_small([own])
    for numbers in places_of(rows, _LEVEL_KEY).values():
        whole = [own for own in (distances[k] for k in numbers) if own is not None]
        found[numbers] |= len(whole) > 1 and _is_too_small(whole)
    return found


def _is_too_small(distances: Sequence[Distances]) -> bool:
    """Whether all of these together are improbably small, by one measure or the other."""
    scales = np.concatenate([one.scales for one in distances])
    whitened = sum(one.whitened for one in distances)
    plain = sum(one.plain for one in distances)
    chances = chance(_SAFETY * whitened, np.ones(len(scales))), chance(_SAFETY * plain, scales)
    return min(chances) < LEVEL / 2


def chance(square: float, scales: np.ndarray) -> float:
    """Chernoff's bound of the chance that a sum ``square`` of squared normal numbers is so small.

    ``scales`` are the numbers' variances.
    """
    if square >= scales.sum():
        return 1.0
    if square <= 0:
        return 0.0

    def slope(tilt: float) -> float:
        return square - float((scales / (1 + 2 * tilt * scales)).sum())

    tilt = brentq(slope, 0, len(scales) / square)
    return float(np.exp(tilt * square - np.log1p(2 * tilt * scales).sum() / 2))


def distances_of(
    rows: pd.DataFrame, scenario: str, sensor: str, study: Study
) -> list[Distances | None]:
    """How far each estimate is from the truth; None for a draw that is not looked at.

    Rows are of one scenario and sensor; they have weights, and noise.
    """
    found: list[Distances | None] = [None] * len(rows)
    known = _truths(_chosen_seeds(rows), scenario, sensor, study)
    prior = _prior_precision([truth.weights for truth in known.values()])
    for (seed, sigma), numbers in places_of(rows, ["seed", "sigma"]).items():
        if seed in known and np.isfinite(prior):
            own = _distances(rows.iloc[numbers], known[seed], float(sigma), prior)
            for k, one in zip(numbers, own, strict=True):
                found[k] = one
    return found


def _chosen_seeds(rows: pd.DataFrame) -> np.ndarray:
    """Seeds of some draws of these rows, the same for the same rows in any order."""
    said = pd.util.hash_pandas_object(rows["weights"].map(str), index=False)
    rng = np.random.default_rng(said.sort_values().to_numpy())
    seeds = np.unique(rows["seed"].to_numpy(int))
    return np.sort(rng.choice(seeds, min(MOST_DRAWS, len(seeds)), replace=False))


def _truths(
    seeds: Iterable[int], scenario: str, sensor: str, study: Study
) -> Mapping[int, TrueScene]:
    """The truths of draws by seed, as far as they are known and no foreign code told them."""
    seen = study.sensors.get(sensor)
    if seen is None or foreign_worlds(study.scenario(scenario), seen):
        return {}
    found = {}
    for seed in seeds:
        with suppress(NoSceneError):
            found[int(seed)] = study.scenes.truth(scenario, int(seed), sensor)
    return found


def _prior_precision(weights: Sequence[np.ndarray]) -> float:
    """Precision of a direction of the simplex before any data, at least that of a uniform prior.

    It is that of the truths themselves; infinite if it is not known.
    """
    rows = np.concatenate(weights) if weights else np.zeros((0, 0))
    spread = ((rows - rows.mean(axis=0)) ** 2).sum() if len(rows) else 0.0
    if spread <= 0:
        return np.inf
    count = rows.shape[1]
    return max(count * (count + 1.0), (len(rows) - 1) * (count - 1) / float(spread))


def _distances(
    rows: pd.DataFrame, truth: TrueScene, sigma: float, prior: float
) -> Iterator[Distances]:
    players, count = truth.weights.shape
    tangent = theta_tangent(count, truth.used)
    of_weights = np.arange(len(tangent)) % (len(tangent) // players) < count
    weights = (tangent[of_weights] != 0).any(axis=0)
    information = truth.information_root.T @ truth.information_root
    precision = information / sigma**2 + np.diag(np.where(weights, prior, 1.0))
    covariance = np.linalg.inv(precision)[np.ix_(weights, weights)]
    scales, directions = np.linalg.eigh(covariance)
    errors = (weights_of(rows, truth.weights.shape) - truth.weights).reshape(len(rows), -1)
    for error in errors @ simplex_tangent(players, count) @ directions:
        yield Distances(float((error**2 / scales).sum()), float((error**2).sum()), scales)

"""Which weights a scenario lets one know, and how close estimators come to the limit.

Fixed scenarios have one truth. Of a family every seed has its own; its first draw stands for it
here, and only that draw's trials are looked at. Where a scenario shows several trajectories, all
of them count.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
import pandas as pd
import pyarrow as pa

from olne_bench.bench.judge.metrics import identifiable_cosine_error
from olne_bench.bench.judge.truth import sensitivities_of, true_recordings
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.report.leaderboard import LIMIT_SIGMA
from olne_bench.bench.report.statistics.attempts import attempts_of, errors_of
from olne_bench.envs.recording import NoEquilibriumError, Recording
from olne_bench.envs.scenarios import is_family
from olne_bench.games.information import Identifiability, identifiability
from olne_bench.games.observation import VIEWS

#: Noise level [m] at which parameters are said to be identified or not.
REFERENCE_SIGMA = LIMIT_SIGMA
_GROUP = ["scenario", "view"]


def identifiability_table(trials: pd.DataFrame) -> pd.DataFrame:
    """One row per scenario, view, player and weight.

    Returns:
        Columns ``scenario, view, player`` (from 1), ``weight, truth``, ``bound`` (Cramer-Rao, as a
        standard deviation at ``REFERENCE_SIGMA``), ``left`` (share of the prior variance that the
        data leave) and ``identified``. Scenarios that cannot be played here have no rows.
    """
    return _table(
        ["truth", "bound", "left", "identified"],
        [
            labels | {"player": i + 1, "weight": weight} | cell
            for labels, truth, known in _known_truths(trials)
            for (i, weight), cell in _cells(truth, known)
        ],
    )


def bound_ratios(trials: pd.DataFrame) -> pd.DataFrame:
    """How far from the Cramer-Rao bound each estimator is, weight by weight.

    Returns:
        Columns ``scenario, view, player, weight, estimator, ratio, identified``: the root mean
        squared error of a weight over its bound, for noise above 0 and up to ``REFERENCE_SIGMA``;
        1 is as good as an unbiased estimator can be, a failure makes it infinite. Where a weight
        is not ``identified`` the bound exceeds what an error can be, and ratios say nothing.
    """
    small = attempts_of(trials)
    small = small[small["sigma"].between(0, REFERENCE_SIGMA, inclusive="right")]
    rows = []
    for labels, truth, known in _known_truths(trials):
        chosen = _rows_of(small, labels)
        for estimator, group in chosen.groupby("estimator", sort=True):
            ratios = _ratios(group, truth, known)
            rows += [
                labels
                | {"player": i + 1, "weight": weight, "estimator": estimator}
                | {"ratio": ratios[i, k], "identified": known.identified[i, k]}
                for i in range(len(ratios))
                for k, weight in enumerate(truth.scenario.game.weight_names)
            ]
    return _table(["estimator", "ratio", "identified"], rows)


def identifiable_errors(trials: pd.DataFrame) -> np.ndarray:
    """``bench.judge.metrics.identifiable_cosine_error`` of each row.

    Infinite for failures, and not a number where it is not known what can be identified.
    """
    errors = np.full(len(trials), np.nan)
    places = pd.Series(np.arange(len(trials)), trials.index)
    for labels, truth, known in _known_truths(trials):
        rows = _rows_of(trials, labels)
        errors[places[rows.index]] = np.inf
        rows = rows[np.isfinite(errors_of(rows, "cosine_error"))]
        shape = truth.scenario.weights.shape
        found = identifiable_cosine_error(
            truth.scenario.weights, weights_of(rows, shape), known.projections
        )
        errors[places[rows.index]] = found
    return errors


def weights_of(rows: pd.DataFrame, shape: tuple[int, ...]) -> np.ndarray:
    """Weights (R, N, K) of rows, none of which lacks them."""
    column = rows["weights"]
    if isinstance(column.dtype, pd.ArrowDtype):
        lists = pa.array(column)
        if isinstance(lists, pa.ChunkedArray):
            lists = lists.combine_chunks()
        return lists.flatten().flatten().to_numpy(zero_copy_only=False).reshape(-1, *shape)
    nested = [[list(player) for player in value] for value in column]
    return np.array(nested, dtype=float).reshape(-1, *shape)


def _known_truths(
    trials: pd.DataFrame,
) -> Iterator[tuple[dict[str, str], Recording, Identifiability]]:
    """Scenario and view as columns, the truth, and what can be known of it."""
    pairs = trials[_GROUP].drop_duplicates().sort_values(_GROUP)
    for scenario, view in pairs.itertuples(index=False):
        first = int(trials.loc[trials["scenario"] == scenario, "seed"].min())
        found = _truth(scenario, view, first)
        if found is not None:
            yield {"scenario": scenario, "view": view}, *found


@lru_cache(maxsize=64)
def _truth(label: str, view: str, seed: int) -> tuple[Recording, Identifiability] | None:
    try:
        recordings = true_recordings(ScenarioEntry.from_label(label), seed)
        known = identifiability(
            recordings[0].scenario.game,
            sensitivities_of(recordings, VIEWS[view]),
            sigma=REFERENCE_SIGMA,
        )
    except (KeyError, TypeError, ValueError, NoEquilibriumError):
        return None  # a scenario or view of another version, or a truth that cannot be varied
    return recordings[0], known


def _rows_of(trials: pd.DataFrame, labels: dict[str, str]) -> pd.DataFrame:
    rows = trials[(trials["scenario"] == labels["scenario"]) & (trials["view"] == labels["view"])]
    if is_family(ScenarioEntry.from_label(labels["scenario"]).name):
        first = trials.loc[trials["scenario"] == labels["scenario"], "seed"].min()
        rows = rows[rows["seed"] == first]
    return rows


def _cells(
    truth: Recording, known: Identifiability
) -> Iterator[tuple[tuple[int, str], dict[str, float | bool]]]:
    for i, weights in enumerate(truth.scenario.weights):
        for k, weight in enumerate(truth.scenario.game.weight_names):
            yield (
                (i, weight),
                {
                    "truth": float(weights[k]),
                    "bound": float(known.bound[i, k]),
                    "left": float(known.left[i, k]),
                    "identified": bool(known.identified[i, k]),
                },
            )


def _ratios(group: pd.DataFrame, truth: Recording, known: Identifiability) -> np.ndarray:
    shape = truth.scenario.weights.shape
    if not np.isfinite(errors_of(group, "cosine_error")).all():
        return np.full(shape, np.inf)
    errors = weights_of(group, shape) - truth.scenario.weights
    relative = errors / (group["sigma"].to_numpy()[:, None, None] / REFERENCE_SIGMA * known.bound)
    return np.sqrt((relative**2).mean(axis=0))


def _table(columns: list[str], rows: list[dict[str, object]]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=[*_GROUP, "player", "weight", *columns])

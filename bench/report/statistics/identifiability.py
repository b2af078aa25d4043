"""Which weights a scenario identifies, and how close estimators come to the limit.

A fixed scenario has one truth. In a family each seed has its own truth; here its first draw stands
for it, and only the trials of that draw count. If a scenario has several trajectories, all of them
count.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pyarrow as pa

from olne_bench.bench.judge.metrics.formulas import identifiable_cosine_error
from olne_bench.bench.judge.scene import NoSceneError, TrueScene
from olne_bench.bench.report.leaderboard import LIMIT_SIGMA
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.games.model.identifiability import Identifiability

#: Noise level [m] at which weights are classified as identified or not.
REFERENCE_SIGMA = LIMIT_SIGMA
_GROUP = ["scenario", "sensor"]


def identifiability_table(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """One row per scenario, sensor, player and weight, or unknown parameter.

    Returns:
        Columns ``scenario, sensor, player`` (from 1), ``weight, truth``, ``bound`` (Cramer-Rao, as
        a standard deviation at ``REFERENCE_SIGMA``), ``left`` (share of the prior variance that is
        left given the data) and ``identified``. A parameter is named with its unit, in which truth
        and bound are given, and is compared with its own prior. Scenarios whose truth is
        not stored have no rows.
    """
    return _table(
        ["truth", "bound", "left", "identified"],
        [
            labels | {"player": i + 1, "weight": weight} | cell
            for labels, truth, known in _known_truths(trials, study)
            for (i, weight), cell in cells(truth, known)
        ],
    )


def bound_ratios(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """How far from the Cramer-Rao bound each estimator is, by weight and unknown parameter.

    Returns:
        Columns ``scenario, sensor, player, weight, estimator, ratio, identified``: the root mean
        squared error of a weight over its bound, for noise above 0 and up to ``REFERENCE_SIGMA``;
        1 is the best that an unbiased estimator can reach; a failure makes it infinite. If a weight
        is not ``identified``, the bound exceeds any possible error and the ratio means nothing.
    """
    attempts, rows = attempts_of(trials), []
    for labels, truth, known in _known_truths(trials, study):
        chosen = _rows_of(attempts, labels, study)
        chosen = chosen[chosen["sigma"].between(0, REFERENCE_SIGMA, inclusive="right")]
        for estimator, group in chosen.groupby("estimator", sort=True):
            ratios = _ratios(group, truth, known)
            rows += [
                labels
                | {"player": i + 1, "weight": weight, "estimator": estimator}
                | {"ratio": ratios[i, k], "identified": known.identified[i, k]}
                for i in range(len(ratios))
                for k, weight in enumerate(truth.weight_names)
            ]
            rows += [
                labels | cell | {"estimator": estimator}
                for cell in _parameter_ratios(group, truth, known)
            ]
    return _table(["estimator", "ratio", "identified"], rows)


def identifiable_errors(trials: pd.DataFrame, study: Study = USUAL) -> np.ndarray:
    """``bench.judge.metrics.formulas.identifiable_cosine_error`` of each row.

    It is infinite for failures, and NaN if it is unknown what can be identified.
    """
    errors = np.full(len(trials), np.nan)
    places = pd.Series(np.arange(len(trials)), trials.index)
    for labels, truth, known in _known_truths(trials, study):
        rows = _rows_of(trials, labels, study)
        errors[places[rows.index]] = np.inf
        rows = rows[_weights_are_there(rows)]
        shape = truth.weights.shape
        found = identifiable_cosine_error(truth.weights, weights_of(rows, shape), known.projections)
        errors[places[rows.index]] = found
    return errors


def weights_of(rows: pd.DataFrame, shape: tuple[int, ...]) -> np.ndarray:
    """Weights (R, N, K) of R rows, all of which have them."""
    return nested_numbers(rows["weights"], shape)


def nested_numbers(column: pd.Series, shape: tuple[int, ...]) -> np.ndarray:
    """Numbers (R, ...) of a column of nested lists, all of which are there."""
    return flat_numbers(column)[0].reshape(-1, *shape)


def flat_numbers(column: pd.Series) -> tuple[np.ndarray, np.ndarray]:
    """All numbers (S,) of a column of nested lists, and the lengths (R,) of the outer lists."""
    if isinstance(column.dtype, pd.ArrowDtype):
        lists = pa.array(column)
        if isinstance(lists, pa.ChunkedArray):
            lists = lists.combine_chunks()
        numbers = lists.flatten().flatten().to_numpy(zero_copy_only=False)
        return numbers, lists.value_lengths().to_numpy(zero_copy_only=False)
    numbers = [number for value in column for player in value for number in player]
    return np.array(numbers, dtype=float), np.array([len(value) for value in column], dtype=int)


def unknown_truths(trials: pd.DataFrame, study: Study = USUAL) -> list[str]:
    """Which scenarios and sensors have no rows in the tables of this module, and why."""
    return [
        f"what can be known of {scenario}, {sensor}: {found}"
        for scenario, sensor, found in _truths(trials, study)
        if isinstance(found, NoSceneError)
    ]


def _known_truths(
    trials: pd.DataFrame, study: Study
) -> Iterator[tuple[dict[str, str], TrueScene, Identifiability]]:
    """Scenario and sensor as columns, the truth, and its identifiability."""
    for scenario, sensor, found in _truths(trials, study):
        if not isinstance(found, NoSceneError):
            known = found.identified_at(REFERENCE_SIGMA)
            yield {"scenario": scenario, "sensor": sensor}, found, known


def _truths(
    trials: pd.DataFrame, study: Study
) -> Iterator[tuple[str, str, TrueScene | NoSceneError]]:
    pairs = trials[_GROUP].drop_duplicates().sort_values(_GROUP)
    for scenario, sensor in pairs.itertuples(index=False):
        seed = _first_seed(trials, scenario)
        try:
            yield scenario, sensor, study.scenes.truth(scenario, seed, sensor)
        except NoSceneError as error:
            yield scenario, sensor, error


def _rows_of(trials: pd.DataFrame, labels: dict[str, str], study: Study) -> pd.DataFrame:
    scenario, sensor = labels["scenario"], labels["sensor"]
    rows = trials[(trials["scenario"] == scenario) & (trials["sensor"] == sensor)]
    if study.is_family(scenario):
        rows = rows[rows["seed"] == _first_seed(trials, scenario)]
    return rows


def _first_seed(trials: pd.DataFrame, scenario: str) -> int:
    """The first seed whose draw has an equilibrium: all trials of the others are skipped."""
    rows = trials[trials["scenario"] == scenario]
    played = attempts_of(rows)
    seeds = (played if len(played) else rows)["seed"]
    return int(seeds.min()) if len(seeds) else -1  # which no trial has


def _weights_are_there(rows: pd.DataFrame) -> np.ndarray:
    """Which rows have an estimate, with or without a prediction."""
    valid = rows["status"].isin(["ok", "failed_forward"])
    return (valid & rows["weights"].notna()).to_numpy(bool)


def cells(
    truth: TrueScene, known: Identifiability
) -> Iterator[tuple[tuple[int, str], dict[str, float | bool]]]:
    """Player (from 0) and name of each weight and unknown parameter, and what is known of it."""
    for i, weights in enumerate(truth.weights):
        for k, weight in enumerate(truth.weight_names):
            yield (
                (i, weight),
                {
                    "truth": float(weights[k]),
                    "bound": float(known.bound[i, k]),
                    "left": float(known.left[i, k]),
                    "identified": bool(known.identified[i, k]),
                },
            )
        yield from _parameter_cells(i, truth, known)


def _parameter_cells(
    i: int, truth: TrueScene, known: Identifiability
) -> Iterator[tuple[tuple[int, str], dict[str, float | bool]]]:
    for k, unknown in enumerate(truth.unknowns[i]):
        yield (
            (i, f"{unknown.name} [{unknown.unit}]"),
            {
                "truth": float(truth.parameters[i, k]),
                "bound": float(known.parameter_bound[i, k] * unknown.deviation),
                "left": float(known.parameter_left[i, k]),
                "identified": bool(known.parameters_identified[i, k]),
            },
        )


def _ratios(group: pd.DataFrame, truth: TrueScene, known: Identifiability) -> np.ndarray:
    shape = truth.weights.shape
    if not _weights_are_there(group).all():
        return np.full(shape, np.inf)
    errors = weights_of(group, shape) - truth.weights
    relative = errors / (group["sigma"].to_numpy()[:, None, None] / REFERENCE_SIGMA * known.bound)
    return np.asarray(np.sqrt((relative**2).mean(axis=0)))


def _parameter_ratios(
    group: pd.DataFrame, truth: TrueScene, known: Identifiability
) -> Iterator[dict[str, object]]:
    """Cells of ``bound_ratios`` for the unknown parameters; none if rows do not hold them."""
    if not truth.used.any() or "unknowns" not in group:
        return
    if _weights_are_there(group).all() and group["unknowns"].notna().all():
        found = nested_numbers(group["unknowns"], truth.parameters.shape)
        errors = (found - truth.parameters) / truth.deviations
        sigma = group["sigma"].to_numpy()[:, None, None] / REFERENCE_SIGMA
        ratios = np.sqrt(((errors / (sigma * known.parameter_bound)) ** 2).mean(axis=0))
    else:
        ratios = np.full(truth.parameters.shape, np.inf)
    for i, own in enumerate(truth.unknowns):
        for k, unknown in enumerate(own):
            yield {
                "player": i + 1,
                "weight": f"{unknown.name} [{unknown.unit}]",
                "ratio": ratios[i, k],
                "identified": known.parameters_identified[i, k],
            }


def _table(columns: list[str], rows: list[dict[str, object]]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=[*_GROUP, "player", "weight", *columns])

"""Which weights a scenario identifies, and how close estimators come to the limit.

A fixed scenario has one truth. In a family each seed has its own; at the reference noise its first
draw stands for it, and only the trials of that draw count. All trajectories of a scenario count.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pyarrow as pa

from olne_bench.bench.judge.metrics.formulas import identifiable_cosine_error
from olne_bench.bench.judge.scene import NoSceneError, TrueScene
from olne_bench.bench.report.leaderboard import LIMIT_SIGMA
from olne_bench.bench.report.parts import joined
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.games.model.identifiability import Identifiability

#: Noise level [m] at which weights are classified as identified or not.
REFERENCE_SIGMA = LIMIT_SIGMA
#: Draws of a family that count at the noise of the trials, from the first on.
MOST_DRAWS = 10
_GROUP = ["scenario", "sensor"]
_WEIGHT = [*_GROUP, "player", "weight"]
_KEY = [*_GROUP, "sigma", "player", "weight"]


def identifiability_table(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """A row per scenario, sensor, player and weight or unknown parameter, if its truth is stored.

    Columns: these, with players from 1; ``truth``; ``bound`` (Cramer-Rao, as a standard deviation
    at ``REFERENCE_SIGMA``), both in the parameter's unit; ``left`` (share of the prior variance
    that is left given the data); ``identified``.
    """
    parts = [
        quantities(truth, known).assign(**labels)
        for labels, truth, known in _known_truths(trials, study)
    ]
    columns = [*_WEIGHT, "truth", "bound", "left", "identified"]
    return joined([pd.DataFrame(columns=columns), *parts])[columns]


def bound_ratios(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """How far from the Cramer-Rao bound each estimator is, by weight and unknown parameter.

    Columns: ``scenario, sensor, player, weight, estimator``; ``ratio``, the root mean squared error
    over the bound for noise up to ``REFERENCE_SIGMA``, at best 1, infinite with a failure;
    ``identified``: else the bound exceeds any possible error, and the ratio means nothing.
    """
    attempts, parts = attempts_of(trials), []
    for labels, truth, known in _known_truths(trials, study):
        chosen = _rows_of(attempts, labels, study)
        chosen = chosen[chosen["sigma"].between(0, REFERENCE_SIGMA, inclusive="right")]
        cells = quantities(truth, known)
        for estimator, group in chosen.groupby("estimator", sort=True):
            found = [_ratios(group, "weights", truth.weights, 1.0, known.bound)]
            own = truth.parameters, truth.deviations, known.parameter_bound
            found.append(_ratios(group, "unknowns", *own))
            ratios = np.hstack(found)[_meant(truth)]
            rows = cells.assign(**labels, estimator=estimator, ratio=ratios)
            told = ~cells["unknown"] | ("unknowns" in group)
            parts.append(rows[told].sort_values("unknown", kind="stable"))
    columns = [*_WEIGHT, "estimator", "ratio", "identified"]
    return joined([pd.DataFrame(columns=columns), *parts])[columns]


def identifiability_by_noise(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """What the data tell about each weight or unknown parameter at the noise of the trials.

    Columns: ``scenario, sensor, sigma`` [m], above 0, ``player`` (from 1), ``weight``; ``draws``
    that count: those whose truth is stored, in a family up to ``MOST_DRAWS``, as weights show in
    some draws only; the median ``bound`` at this noise, infinite where none exists; the mean share
    ``left`` of the prior variance; the share of draws in which it is ``identified``.
    """
    parts = []
    for (scenario, sensor), group in attempts_of(trials).groupby(_GROUP, sort=True):
        labels = {"scenario": str(scenario), "sensor": str(sensor)}
        levels = np.unique(group["sigma"].to_numpy(float))
        seeds = np.unique(group["seed"].to_numpy(int))
        for seed in seeds[: MOST_DRAWS if study.is_family(str(scenario)) else 1]:
            try:
                truth = study.scenes.truth(str(scenario), int(seed), str(sensor))
            except NoSceneError:
                continue
            for sigma in levels[levels > 0]:
                cells = quantities(truth, truth.identified_at(float(sigma)))
                parts.append(cells.assign(**labels, sigma=sigma))
    if not parts:
        return pd.DataFrame(columns=[*_KEY, "draws", "bound", "left", "identified"])
    return (
        pd.concat(parts)
        .groupby(_KEY, sort=False)
        .agg(
            draws=("left", "size"),
            bound=("bound", "median"),
            left=("left", "mean"),
            identified=("identified", "mean"),
        )
        .reset_index()
    )


def identifiable_errors(trials: pd.DataFrame, study: Study = USUAL) -> np.ndarray:
    """``identifiable_cosine_error`` of each row: infinite for failures, NaN where it is unknown."""
    errors = np.full(len(trials), np.nan)
    places = pd.Series(np.arange(len(trials)), trials.index)
    for labels, truth, known in _known_truths(trials, study):
        rows = _rows_of(trials, labels, study)
        errors[places[rows.index]] = np.inf
        rows = rows[_weights_are_there(rows)]
        found = weights_of(rows, truth.weights.shape)
        found = identifiable_cosine_error(truth.weights, found, known.projections)
        errors[places[rows.index]] = found
    return errors


def unknown_truths(trials: pd.DataFrame, study: Study = USUAL) -> list[str]:
    """Which scenarios and sensors have no truth here, and why."""
    return [
        f"what can be known of {scenario}, {sensor}: {found}"
        for scenario, sensor, found in _truths(trials, study)
        if isinstance(found, NoSceneError)
    ]


def weights_of(rows: pd.DataFrame, shape: tuple[int, ...]) -> np.ndarray:
    """Weights (R, N, K) of R rows, all of which have them."""
    return flat_numbers(rows["weights"])[0].reshape(-1, *shape)


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


def quantities(truth: TrueScene, known: Identifiability) -> pd.DataFrame:
    """What is known of each player's weights, and then of its unknown parameters.

    Columns: ``player`` (from 1), ``weight`` (a name, of a parameter with its unit), ``unknown``
    (whether it is a parameter), ``truth, bound, left, identified``.
    """
    meant = _meant(truth)
    players, columns = np.nonzero(meant)
    units = [[f"{one.name} [{one.unit}]" for one in own] for own in truth.unknowns]
    values = {
        "truth": (truth.weights, truth.parameters),
        "bound": (known.bound, known.parameter_bound * truth.deviations),
        "left": (known.left, known.parameter_left),
        "identified": (known.identified, known.parameters_identified),
    }
    return pd.DataFrame(
        {
            "player": players + 1,
            "weight": [name for own in units for name in (*truth.weight_names, *own)],
            "unknown": columns >= len(truth.weight_names),
            **{name: np.hstack(both)[meant] for name, both in values.items()},
        }
    )


def _meant(truth: TrueScene) -> np.ndarray:
    """(N, K + U) which columns of weights and parameters stand for something."""
    return np.hstack([np.ones(truth.weights.shape, bool), truth.used])


def _ratios(
    group: pd.DataFrame,
    column: str,
    truths: np.ndarray,
    units: np.ndarray | float,
    bound: np.ndarray,
) -> np.ndarray:
    """Root mean squared errors (N, K) of estimates over their bound; infinite if one is missing."""
    told = truths.size and column in group
    if not told or not (_weights_are_there(group) & group[column].notna()).all():
        return np.full(truths.shape, np.inf)
    errors = (flat_numbers(group[column])[0].reshape(-1, *truths.shape) - truths) / units
    sigma = group["sigma"].to_numpy()[:, None, None] / REFERENCE_SIGMA
    return np.asarray(np.sqrt(((errors / (sigma * bound)) ** 2).mean(axis=0)))


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


def _weights_are_there(rows: pd.DataFrame) -> pd.Series:
    """Which rows have an estimate, with or without a prediction."""
    return rows["status"].isin(["ok", "failed_forward"]) & rows["weights"].notna()

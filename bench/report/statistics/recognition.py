"""Who is recognised: results by the temperament of drivers (``envs.roads.temperaments``).

Temperaments are stored with the truths. An estimate recognises a driver if its weights have the
largest density under the driver's own temperament.
"""

from contextlib import suppress

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.formulas import cosine_errors
from olne_bench.bench.judge.scene import NoSceneError, TrueScene
from olne_bench.bench.report.statistics.attempts import attempts_of, quantile
from olne_bench.bench.report.statistics.identifiability import weights_of
from olne_bench.bench.report.statistics.intervals import share_interval
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.envs.roads.temperaments import TEMPERAMENTS, recognised
from olne_bench.envs.scenarios.true_weights import TEMPERED
from olne_bench.plugins import SCENARIO, is_built_in

#: Recognised temperament of a driver whose trial has no valid weights.
NOBODY = "none"

_CELL = ["scenario", "sensor", "sigma", "estimator"]
_OF_TRUE = [*_CELL, "temperament"]
_LABELS = ["scenario", "sensor", "estimator"]
_SUMMARY = ["drivers", "failures", *(f"cosine_error_{kind}" for kind in ("median", "q25", "q75"))]
_SUMMARY += ["recognised", "recognised_low", "recognised_high"]
#: Millions of drivers fit into memory as long as their names are numbers, so these are categories.
_NAMES = pd.CategoricalDtype(sorted([*TEMPERAMENTS, NOBODY]))
_DRIVER = [*_CELL, "seed", "temperament", "recognised", "cosine_error"]


def drivers(trials: pd.DataFrame, study: Study = USUAL) -> pd.DataFrame:
    """Every driver of every attempt in scenarios whose drivers have temperaments.

    Columns: ``scenario, sensor, sigma, estimator, seed, temperament, recognised`` (or ``NOBODY``)
    and ``cosine_error`` of the driver's weights, infinite for failures. Names are categories.
    """
    labels = [label for label in trials["scenario"].unique() if is_tempered(label, study)]
    attempts = attempts_of(trials[trials["scenario"].isin(labels)])
    attempts = attempts.astype(dict.fromkeys(_LABELS, "category"))
    parts = []
    for label, of_label in attempts.groupby("scenario", sort=True, observed=True):
        for seed, rows in of_label.groupby("seed", sort=True):
            with suppress(NoSceneError):
                truth = study.scenes.truth(str(label), int(str(seed)))
                parts.append(_drivers_of_draw(rows, truth))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=_DRIVER)


def is_tempered(label: str, study: Study) -> bool:
    """Whether the drivers of the scenario with this label have temperaments."""
    entry = study.scenarios.get(label)
    tempered = entry is not None and entry.options.get("weights") == TEMPERED
    return tempered and is_built_in(SCENARIO, entry.name)  # type: ignore[union-attr]


def temperament_table(found: pd.DataFrame) -> pd.DataFrame:
    """Results of ``drivers`` by scenario, sensor, noise level, estimator and true temperament.

    Columns: these, ``sigma`` being NaN for all levels together; ``drivers``, ``failures``; median
    and quartiles of the cosine error of their weights (failures at infinity); the share
    ``recognised`` with its 95 % interval over draws.
    """
    rows = [
        (*key, *_summary(group))
        for part in (found.assign(sigma=np.nan), found)
        for key, group in part.groupby(_OF_TRUE, dropna=False, observed=True)
    ]
    return pd.DataFrame(rows, columns=[*_OF_TRUE, *_SUMMARY])


def confusion_table(found: pd.DataFrame) -> pd.DataFrame:
    """Who of ``drivers`` is mistaken for whom.

    Columns: ``scenario, sensor, sigma, estimator``, the true ``temperament`` and the one that is
    ``recognised``, as far as they occur; ``drivers``, and their ``share`` of that temperament's.
    """
    counts = found.groupby([*_OF_TRUE, "recognised"], observed=True).size().rename("drivers")
    table = counts.reset_index().astype(dict.fromkeys([*_LABELS, "temperament", "recognised"], str))
    table["share"] = table["drivers"] / table.groupby(_OF_TRUE)["drivers"].transform("sum")
    return table


def _summary(group: pd.DataFrame) -> tuple[float | int, ...]:
    """The values of the columns ``_SUMMARY``."""
    errors, once = group["cosine_error"].to_numpy(float), np.ones(len(group), int)
    right = (group["recognised"] == group["temperament"]).to_numpy(float)
    share = share_interval(right, group["seed"].to_numpy())
    quantiles = [quantile(errors, once, part) for part in (0.5, 0.25, 0.75)]
    failures = int(group["recognised"].eq(NOBODY).sum())
    return len(group), failures, *quantiles, share.estimate, share.low, share.high


def _drivers_of_draw(rows: pd.DataFrame, truth: TrueScene) -> pd.DataFrame:
    """The drivers of the attempts on one draw."""
    names, weights = truth.temperaments, truth.weights
    valid = rows["status"].isin(["ok", "failed_forward"]) & rows["weights"].notna()
    seen = np.full((len(rows), len(names)), NOBODY, dtype=object)
    errors = np.full(seen.shape, np.inf)
    if valid.any():
        estimated = weights_of(rows[valid], weights.shape)
        seen[valid] = recognised(estimated, truth.shares)
        errors[valid] = cosine_errors(weights, estimated)
    places = np.repeat(np.arange(len(rows)), len(names))
    found = rows[[*_CELL, "seed"]].iloc[places].reset_index(drop=True)
    return found.assign(
        temperament=pd.Categorical(list(names) * len(rows), dtype=_NAMES),
        recognised=pd.Categorical(seen.ravel(), dtype=_NAMES),
        cosine_error=errors.ravel(),
    )

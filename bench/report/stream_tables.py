"""Tables of streams: a motion, whose samples depend on each other, counts once, by its median."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

import msgspec
import numpy as np
import pandas as pd

from olne_bench.bench.judge.streams import ERROR_COLUMNS, Update
from olne_bench.bench.plan.kinds import CONSTANT_VELOCITY, REFERENCES, STOCK_FITTED
from olne_bench.bench.plan.outcome import FAILURES
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import KEY_COLUMNS
from olne_bench.bench.report.statistics.attempts import FLOOR, attempts_of
from olne_bench.bench.report.statistics.intervals import median_interval
from olne_bench.bench.report.statistics.pairs import compare_pairs, holm
from olne_bench.bench.run.store import Store

#: Columns of a row: what identifies the motion and the estimator, the update, and its errors.
COLUMNS = (
    *KEY_COLUMNS,
    *(field.name for field in fields(Update) if field.name != "errors"),
    *ERROR_COLUMNS,
)
#: What a line of the tables is about.
_GROUP = ["scenario", "sensor", "sigma", "estimator"]

#: Columns of errors, and those of them that tables give intervals of.
_ERRORS = ("cosine_error", *ERROR_COLUMNS)
_SURE = ("cosine_error", "fde_1s", "fde_3s")

#: The error by which estimators are compared, and what with: the other error is multiplied by a
#: factor first, so that a third of it has to be undercut.
_COMPARED = "fde_3s"
_RIVALS = ((CONSTANT_VELOCITY, 1 / 3), (STOCK_FITTED, 1.0))
_PLACE = ["scenario", "sensor", "sigma", "seed"]
_COMPARISON = ["scenario", "sensor", "estimator", "other", "factor", "ratio", "pairs", "units"]
_COMPARISON += ["wins", "wins_low", "wins_high", "p"]


def update_table(store: Store, suite: Suite) -> pd.DataFrame:
    """A row for each sample of each motion in a store, with ``COLUMNS``, in the suite's order.

    A motion that an estimator did not follow has one row, whose ``sample`` is 0.
    """
    rows: list[dict[str, Any]] = []
    for batch in store.batches():
        for record in batch.to_pylist():
            nothing = record["extras"] is None and record["status"] == "skipped"
            if not (nothing and record["estimator"] in suite.references):
                rows += _rows_of(record)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    places = table[[*_PLACE, "estimator", "sample"]].copy()
    for name in ("scenario", "sensor", "estimator"):
        rank = {entry.label: k for k, entry in enumerate(getattr(suite, f"{name}s"))}
        places[name] = table[name].map(rank).fillna(len(rank))  # what it lacks comes last
    order = places.sort_values(list(places.columns), kind="stable").index
    return table.loc[order].reset_index(drop=True)


def _rows_of(record: dict[str, Any]) -> list[dict[str, Any]]:
    labels = {name: record[name] for name in KEY_COLUMNS}
    if record["extras"] is None:
        told = {"sample": 0, "status": record["status"], "message": record["message"]}
        return [labels | told | {"late": False}]
    updates = msgspec.json.decode(record["extras"])
    return [labels | update | update["errors"] for update in updates]


def summary_table(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each scenario, sensor, noise level and estimator of an ``update_table``.

    Columns: ``motions, updates``; ``failed, late``, shares of updates; ``latency_50, _95, _99``
    [ms], percentiles over updates; ``half_time`` [s], the median time until the cosine error is
    half of that of uniform weights, missing where most motions do not get there; medians over
    motions of the cosine error and of errors of predictions [m]; ends ``_low, _high`` of 95 %
    intervals, infinite for times that are never reached.
    """
    lines = []
    for key, part in attempts_of(rows).groupby(_GROUP, sort=False):
        latency = part["latency"].dropna().to_numpy(float) * 1e3
        line: dict[str, Any] = dict(zip(_GROUP, key, strict=True)) | {
            "motions": part["seed"].nunique(),
            "updates": len(part),
            "failed": part["status"].isin(FAILURES).mean(),
            "late": part["late"].astype(bool).mean(),
        }
        for level in (50, 95, 99):
            line[f"latency_{level}"] = np.percentile(latency, level) if len(latency) else np.nan
        line |= median_interval(_half_times(part)).columns("half_time")
        if np.isinf(line["half_time"]):
            line["half_time"] = np.nan
        lines.append(line | _errors(part.groupby("seed")[list(_ERRORS)].median()))
    return pd.DataFrame(lines)


def over_time_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Medians over motions of the errors at each time, by scenario, noise and estimator.

    Those of ``_SURE`` have intervals, as in ``summary_table``.
    """
    key = [*_GROUP, "time"]
    parts = attempts_of(rows).groupby(key, sort=False)
    return pd.DataFrame([dict(zip(key, at, strict=True)) | _errors(part) for at, part in parts])


def comparison_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Whether the error ``_COMPARED`` of each estimator is below that of each of ``_RIVALS``.

    Samples count for which the rival has a prediction; an estimator that has none there loses. A
    draw counts once, at all its noise levels. Columns: ``scenario, sensor, estimator, other,
    factor``; ``ratio``, the median over motions of the error over the other's; ``pairs`` (motions),
    ``units`` (draws); ``wins``, the share of motions with an error below ``factor`` times the
    other's, with ``wins_low, wins_high`` (95 %); ``p`` of a permutation test; ``p_holm``, adjusted
    after Holm for all rows.
    """
    table = pd.DataFrame(_compared(attempts_of(rows)), columns=_COMPARISON)
    return table.assign(p_holm=holm(table["p"].to_numpy(float)))


def _compared(judged: pd.DataFrame) -> Iterator[dict[str, Any]]:
    for (scenario, sensor), part in judged.groupby(["scenario", "sensor"], sort=False):
        errors = dict(list(part.groupby("estimator", sort=False)))
        for name in [one for one in errors if one not in (*REFERENCES["streams"], FLOOR)]:
            for other, factor in _RIVALS:
                if other in errors:
                    pairs = _pairs(errors[name], errors[other])
                    ratio = float(np.median(pairs["a"] / pairs["b"])) if len(pairs) else np.nan
                    found = compare_pairs(pairs.assign(b=factor * pairs["b"]), family=True)
                    labels = {"scenario": scenario, "sensor": sensor, "estimator": name}
                    yield labels | {"other": other, "factor": factor, "ratio": ratio} | found


def _pairs(own: pd.DataFrame, other: pd.DataFrame) -> pd.DataFrame:
    """Medians ``a`` and ``b`` of each motion over the samples after which the other predicts."""
    key = [*_PLACE, "sample"]
    theirs = other.loc[other[_COMPARED].notna(), [*key, _COMPARED]].rename(columns={_COMPARED: "b"})
    mine = own[[*key, _COMPARED]].rename(columns={_COMPARED: "a"})
    both = theirs.merge(mine, on=key)
    both["a"] = both["a"].fillna(np.inf)
    return both.groupby(_PLACE, sort=False)[["a", "b"]].median().reset_index()


def _errors(part: pd.DataFrame) -> dict[str, float]:
    """Medians of errors, one row a motion."""
    line: dict[str, float] = {}
    for name in _ERRORS:
        found = median_interval(part[name].dropna().to_numpy(float))
        line |= found.columns(name) if name in _SURE else {name: found.estimate}
    return line


def _half_times(part: pd.DataFrame) -> np.ndarray:
    """Times of the motions until the prior's error is halved [s]; infinite where it never is."""
    if part["cosine_error"].isna().all():
        return np.empty(0)
    told = part[part["cosine_error"].notna()]
    halved = told[told["cosine_error"] <= told["prior_error"] / 2]
    first = halved.groupby("seed")["time"].min()
    return first.reindex(part["seed"].unique()).fillna(np.inf).to_numpy(float)

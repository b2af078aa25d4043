"""Tables of drives: a line for each road, traffic and planner, and paired tests."""

from dataclasses import asdict, fields
from itertools import product
from typing import Any

import msgspec
import numpy as np
import pandas as pd
from scipy.stats import binomtest, bootstrap, permutation_test

from olne_bench.bench.judge.drives import ERROR_COLUMNS, DriveRow, setting
from olne_bench.bench.plan.kinds import CONSTANT_VELOCITY, ORACLE, REFERENCES, UNIFORM
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.statistics.intervals import Interval
from olne_bench.bench.report.statistics.pairs import holm, permutation_p
from olne_bench.bench.run.store import Store
from olne_bench.envs.drive.cars import ROADS
from olne_bench.envs.drive.setting import DriveSetting

_PLACE = tuple(one.name for one in fields(DriveSetting))
_TOLD = tuple(one.name for one in fields(DriveRow) if one.name != "errors")
#: Columns of a row: what identifies the drive and its planner, what became of it, and its errors.
COLUMNS = (*_PLACE, "sigma", "seed", "salt_id", "planner", *_TOLD, *ERROR_COLUMNS)
_TEXTS = (*_PLACE, "salt_id", "planner", "status", "message", "collision")
_COUNTS = (
    *("plans_solved", "plans_apart", "plans_kept", "plans_braked"),
    *("entered", "left", "others_collided"),
)

#: What drives of a line have in common, besides the planner; ``all`` stands for all roads.
_GROUP, _ALL_ROADS = ["road", "traffic", "sigma"], "all"
_LINE = [*_GROUP, "planner"]
_PAIR = ["where", "traffic", "sigma", "weights", "salt_id", "seed"]

#: Columns whose medians are shown, and whose largest values.
_MEDIANS = ("cost", "progress", "jerk", "gap", "cycle_50", *ERROR_COLUMNS)
_MEANS = ("fallback", "late", "failed")
#: Columns that are compared, and with which planners.
_TESTED, _RIVALS = ("collision", "cost", ERROR_COLUMNS[-1]), (UNIFORM, CONSTANT_VELOCITY)

_LEAST = 6  # drives, for an interval or a test
_RESAMPLES = 4999  # of a bootstrap
#: Sign changes of a test: its smallest p-value is 1e-4, which is significant in some hundred lines
#: after Holm. So many at a time, to keep memory small.
_SIGN_CHANGES, _BATCH = 19_999, 2000
_ROUNDING = 1e-9  # of costs


def episode_table(store: Store, suite: Suite) -> pd.DataFrame:
    """A row for each drive in a store, with ``COLUMNS``."""
    rows: list[dict[str, Any]] = []
    for batch in store.batches():
        for record in batch.to_pylist():
            place = asdict(setting(suite.scenario(record["scenario"])))
            known = msgspec.json.decode(record["extras"]) if record["extras"] else {}
            errors = known.pop("errors", {})
            rows.append(record | place | {"planner": record["estimator"]} | known | errors)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    numbers = [name for name in COLUMNS if name not in (*_TEXTS, *_COUNTS, "seed")]
    return table.astype(dict.fromkeys(numbers, float) | dict.fromkeys(_COUNTS, "Int64"))


def drive_table(rows: pd.DataFrame) -> pd.DataFrame:
    """A line for each road, or all, traffic, noise level and planner of an ``episode_table``.

    Columns: ``drives``; ``collisions``, and their share ``collision, collision_low,
    collision_high`` (95 %, Clopper and Pearson); ``regret, regret_low, regret_high``, the mean cost
    less that of the oracle in the same drive (95 %, bootstrap); medians of cost, progress [m],
    jerk [m/s^3], gap [m], percentiles of cycles [ms] and errors of predictions [m]; means of the
    shares ``fallback, late, failed``.
    """
    whole = _with_all_roads(attempts_of(rows))
    parts = dict(list(whole.groupby(_LINE, sort=False)))
    lines = []
    for key, part in parts.items():
        line = dict(zip(_LINE, key, strict=True)) | {"drives": len(part)} | collision_share(part)
        line |= regret_of(part, parts.get((*key[:-1], ORACLE), whole.iloc[:0]))
        line |= {name: part[name].median() for name in (*_MEDIANS, "cycle_95", "cycle_99")}
        line |= {name: part[name].mean() for name in _MEANS}
        lines.append(line)
    return pd.DataFrame(lines)


def comparison_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Paired tests of planners of an ``episode_table`` against ``_RIVALS``.

    Columns: ``column``, what is compared; ``road, traffic, sigma, planner, other, pairs``;
    ``difference``, the mean of the planner less the other; ``p`` of a paired permutation test,
    exact for collisions; ``p_holm``, adjusted after Holm for all lines.
    """
    whole = _with_all_roads(attempts_of(rows))
    lines = []
    for key, group in whole.groupby(_GROUP, sort=False):
        parts = dict(list(group.groupby("planner", sort=False)))
        for column, other, planner in product(_TESTED, _RIVALS, parts):
            if planner in (other, CONSTANT_VELOCITY) or other not in parts:
                continue
            pairs = paired_differences(parts[planner], parts[other], column)
            if len(pairs):
                named = dict(zip(_GROUP, key, strict=True)) | {"planner": planner, "other": other}
                lines.append({"column": column} | named | tested(pairs))
    table = pd.DataFrame(lines, columns=["column", *_LINE, "other", "pairs", "difference", "p"])
    known = table["p"].notna()
    table["p_holm"] = np.nan
    table.loc[known, "p_holm"] = holm(table.loc[known, "p"].to_numpy(float))
    return table


def _with_all_roads(judged: pd.DataFrame) -> pd.DataFrame:
    """Rows, by road and planner, with their road as ``where``; each again as of ``_ALL_ROADS``."""
    rank = {name: k for k, name in enumerate(REFERENCES["drives"])}  # the oracle is the first
    order = judged["planner"].map(rank).fillna(0.5)  # estimators are next
    placed = judged.assign(where=judged["road"], rank=order)
    placed["place"] = judged["road"].map(list(ROADS).index)
    placed = placed.sort_values(["place", "rank", "planner", "seed"], kind="stable")
    if placed["road"].nunique() < 2:
        return placed
    return pd.concat([placed, placed.assign(road=_ALL_ROADS)])


def paired_differences(first: pd.DataFrame, second: pd.DataFrame, column: str) -> np.ndarray:
    """Differences (D,) between the drives in which both have a value."""
    values = [rows.set_index(_PAIR)[column].astype(float) for rows in (first, second)]
    joined = pd.concat(values, axis=1, join="inner").dropna().to_numpy(float)
    return np.asarray(joined[:, 0] - joined[:, 1])


def collision_share(part: pd.DataFrame) -> dict[str, float]:
    """``collisions``, and their share with its exact 95 % interval."""
    hit, count = int(part["collision"].astype(bool).sum()), len(part)
    ends = binomtest(hit, count).proportion_ci(method="exact")
    share = Interval(hit / count, float(ends.low), float(ends.high))
    return {"collisions": hit, **share.columns("collision")}


def regret_of(part: pd.DataFrame, oracle: pd.DataFrame) -> dict[str, float]:
    """Mean cost less the oracle's in the same drives, with its 95 % interval (bootstrap)."""
    regrets = paired_differences(part, oracle, "cost")
    found = Interval(float(regrets.mean()) if len(regrets) else np.nan)
    if len(regrets) >= _LEAST and np.ptp(regrets) > _ROUNDING:
        drawn: dict[str, Any] = {"n_resamples": _RESAMPLES, "rng": np.random.default_rng(0)}
        ends = bootstrap((regrets,), np.mean, method="percentile", **drawn).confidence_interval
        found = Interval(found.estimate, float(ends.low), float(ends.high))
    return found.columns("regret")


def tested(differences: np.ndarray, sign_changes: int = _SIGN_CHANGES) -> dict[str, float]:
    """``pairs``, their mean ``difference``, and ``p`` of a paired permutation test."""
    p = np.nan
    if len(differences) >= _LEAST and not np.any(differences % 1):  # collisions, or all ties
        p = permutation_p(differences.astype(int))
    elif len(differences) >= _LEAST:
        found = permutation_test(
            (differences, np.zeros_like(differences)),
            lambda one, other, axis: np.mean(one - other, axis=axis),
            permutation_type="samples",
            vectorized=True,
            batch=_BATCH,
            n_resamples=sign_changes,
            rng=np.random.default_rng(0),
        )
        p = float(found.pvalue)
    return {"pairs": len(differences), "difference": float(differences.mean()), "p": p}

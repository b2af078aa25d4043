"""The leaderboard as text for a terminal, with a legend and notes."""

import math
from functools import partial

import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.measures import in_leaderboard, primary
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.bench.report.statistics.harness_errors import in_words
from olne_bench.bench.report.statistics.standing import said_of_standing
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.bench.report.tables import RunTables
from olne_bench.bench.text import one_line

#: Counts that are shown even if all are 0.
_ALWAYS = ("trials", "failures", "published_failures")
_LEGEND = """
Medians and quartiles [IQR] are over all trials; a failure counts as infinitely wrong.
published_failures: also those where the published search misses a root that another one finds."""
_LEGEND_OF_RANKS = """
rank: by {metric}; differences that are not significant are ties. There is none where so few
trials are independent that none could be, or for an estimator run on a small part of the trials.
/limit: mean cosine error over its statistical limit (the Cramer-Rao bound) at little noise.
ms: median time of one estimate; those that were stopped or broke off count as infinitely slow."""
_FLOOR_LEGEND = """
uniform is the floor: equal weights. In two_player the true weights happen to be equal."""


def format_leaderboard(table: pd.DataFrame, study: Study = USUAL) -> str:
    """The leaderboard with a legend."""
    metrics = in_leaderboard(study.metrics, table)
    shown = pd.DataFrame(
        {name: table[name].map(one_line) for name in ("scenario", "sensor", "estimator")}
    )
    for name in ("trials", "failures", "published_failures", "harness_errors", "implausible"):
        if name in _ALWAYS or (name in table and (table[name] > 0).any()):
            shown[name] = table[name]
    for metric in metrics:
        head = f"{metric.label} [IQR]" if metric.compared else metric.label
        shown[head] = _cells(table, metric)
    shown["/limit"] = table["limit_ratio"].map(partial(_short, digits=".2f"))
    first = primary(metrics)
    if first is not None and f"{first.name}_rank" in table:
        shown["rank"] = table[f"{first.name}_rank"].astype("string").fillna("-")
    shown["ms"] = (1e3 * table["solve_seconds_median"]).map(partial(_short, digits=".1f"))
    told = "".join(f"\n{_legend(metric)}" for metric in metrics)
    ranks = _LEGEND_OF_RANKS.format(metric=first.label) if first else ""
    floor = _FLOOR_LEGEND if FLOOR in set(table["estimator"]) else ""
    return f"{shown.to_string(index=False)}\n{_LEGEND}{told}{ranks}{floor}"


def format_notes(tables: RunTables, notes: list[str]) -> str:
    """Who does not rank, errors of the harness, what could not be drawn; empty without them.

    Args:
        tables: tables of the run.
        notes: what could not be drawn, and why.
    """
    wrong = in_words(tables.harness_errors)
    parts = [
        ("Not ranked, or too good:", said_of_standing(tables.leaderboard)),
        ("The harness itself failed; these trials do not count as attempts:", wrong),
        ("Not shown, and why:", notes),
    ]
    return "\n".join(
        "\n".join([head, *(f"  {n}" for n in lines)]) for head, lines in parts if lines
    )


def _cells(table: pd.DataFrame, metric: MetricDeclaration) -> list[str]:
    if metric.is_share:
        return [f"{share:.0%}".replace("nan%", "-") for share in table[f"{metric.name}_share"]]
    if not metric.compared:
        return [_short(value) for value in table[f"{metric.name}_median"]]
    quartiles = table[[f"{metric.name}_{name}" for name in ("median", "q25", "q75")]]
    return [
        f"{_short(median)} [{_short(low)}, {_short(high)}]"
        for median, low, high in quartiles.itertuples(index=False)
    ]


def _legend(metric: MetricDeclaration) -> str:
    unit = f" [{metric.unit}]" if metric.unit else ""
    return f"{metric.label}{unit}: {metric.description or 'its median.'}"


def _short(value: float, digits: str = ".2g") -> str:
    if math.isnan(value):
        return "-"
    return "∞" if math.isinf(value) else f"{value:{digits}}"


def format_summary(heading: str, summary: pd.DataFrame, failed: pd.DataFrame, unit: str) -> str:
    """The summary of a study of streams or drives, and what failed in it.

    Args:
        heading: what the columns hold.
        summary: columns to be shown.
        failed: rows with another status than ``ok``.
        unit: what a row is, in the plural.
    """
    shown = summary.to_string(index=False, float_format=lambda v: f"{v:.3g}", na_rep="-")
    reasons = failed.groupby(["status", "message"])
    told = [f"{len(part)} {unit} {status}: {message}" for (status, message), part in reasons]
    return "\n".join([heading, shown, *told])

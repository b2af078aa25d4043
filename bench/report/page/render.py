"""Put the page together."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.measures import FAILURES, in_leaderboard, primary
from olne_bench.bench.report.page.cards import FIELDS, cards, measured_cost
from olne_bench.bench.report.page.data import chart_data
from olne_bench.bench.report.page.matrices import SEEN, driver_rows, win_rows
from olne_bench.bench.report.page.template import csv_texts, script, table_rows, template
from olne_bench.bench.report.page.verdicts import verdicts
from olne_bench.bench.report.parts import Parts, parts_of
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.bench.report.statistics.estimator_comparison import SIGNIFICANCE, leaders
from olne_bench.bench.report.statistics.harness_errors import in_words
from olne_bench.bench.report.statistics.identifiability import REFERENCE_SIGMA
from olne_bench.bench.report.statistics.standing import said_of_standing
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.bench.report.tables import RunTables
from olne_bench.bench.run.provenance import Provenance

#: Parts of the page's script, in the order in which they need each other.
SCRIPTS = (
    *("look", "vector", "save", "gif", "choice", "links", "board", "charts", "scenes", "player"),
    "main",
)
_SMALLEST_SHOWN = 1e-6  # of errors on bars
_CONSTANTS = {
    "sigma": REFERENCE_SIGMA,
    "significance": SIGNIFICANCE,
    "floor": FLOOR,
    "failures": FAILURES.name,
}


@dataclass(frozen=True)
class Bar:
    """A median and its quartiles on a scale from 0 to 100; an infinite median is None."""

    low: float
    mid: float | None
    high: float


@dataclass(frozen=True)
class Extras:
    """Optional parts of a page.

    Attributes:
        title: title. Default: the suite's name.
        playable: noise levels and seeds of sequences that must be playable.
        changes: table of ``bench.report.statistics.run_comparison``, for a page of two runs.
    """

    title: str = ""
    playable: tuple[tuple[float, int], ...] = ()
    changes: pd.DataFrame | None = None


PLAIN = Extras()


@dataclass(frozen=True)
class Page:
    """The page.

    Attributes:
        html: the HTML text.
        notes: what it cannot show, and why.
    """

    html: str
    notes: list[str]


def render_page(
    trials: pd.DataFrame | Parts,
    tables: RunTables,
    runs: Sequence[Provenance],
    study: Study = USUAL,
    notes: Sequence[str] = (),
    extras: Extras = PLAIN,
) -> Page:
    """The page as HTML.

    Args:
        trials: rows of a run.
        tables: tables of these rows.
        runs: provenance of the rows, the latest run last.
        study: study of the run.
        notes: further notes for the page, on what could not be shown.
        extras: optional parts.
    """
    parts, table = parts_of(trials), tables.leaderboard
    charts = chart_data(parts, study, extras.playable)
    metrics = in_leaderboard(study.metrics, table)
    first = primary(metrics)
    labels = style.estimator_order(table["estimator"].tolist())
    html = template("template.html").render(
        title=extras.title or parts.outline.suite,
        description=_description(runs),
        script=script(SCRIPTS),
        data=charts.content | {"tables": csv_texts(tables.by_name())},
        colours={n: style.estimator_colours(n) for n in labels},
        verdicts=verdicts(table, tables.comparisons, study),
        rows=_board(table, metrics, first),
        metrics=metrics,
        primary=first,
        changes=None if extras.changes is None else table_rows(extras.changes),
        paragraphs=tables.paragraphs,
        **_matrices(tables, labels),
        comparisons=table_rows(tables.comparisons),
        weights=_weights(tables),
        calibration=table_rows(tables.calibration),
        cards=[(card, measured_cost(table, card.label)) for card in cards(study, labels)],
        fields=FIELDS,
        trial_count=int(table["trials"].sum()),
        harness_errors=in_words(tables.harness_errors),
        standings=said_of_standing(table),
        implausible="implausible" in table and bool(table["implausible"].any()),
        notes=list(dict.fromkeys([*notes, *charts.notes])),
        runs=list(runs),
        **_CONSTANTS,
    )
    return Page(html, charts.notes)


def _matrices(tables: RunTables, labels: Sequence[str]) -> dict[str, Any]:
    """Draws won, and recognised temperaments."""
    drivers = driver_rows(tables.temperaments, tables.confusions)
    return {"wins": win_rows(tables.wins, labels), "drivers": drivers, "seen": SEEN}


def _description(runs: Sequence[Provenance]) -> str:
    """The suite's description, if it is known."""
    return str(json.loads(runs[-1].suite).get("description", "")) if runs else ""


def _board(
    table: pd.DataFrame, metrics: Sequence[MetricDeclaration], first: MetricDeclaration | None
) -> list[dict[str, Any]]:
    """Rows of the leaderboard with their bars; the floor comes last in its scenario and sensor."""
    ranked = [m.name for m in metrics if f"{m.name}_rank" in table]
    table = table.assign(**{f"{name}_leads": leaders(table, name) for name in ranked})
    table = table.assign(
        **{
            f"{name}_rank": table[f"{name}_rank"]
            .astype("Float64")
            .to_numpy(float, na_value=math.nan)
            for name in ranked
        }
    )
    bars = _bars(table, first) if first else [Bar(0.0, None, 0.0)] * len(table)
    rows = [row | {"bar": bar} for row, bar in zip(table_rows(table), bars, strict=True)]
    groups = list(dict.fromkeys((row["scenario"], row["sensor"]) for row in rows))
    place = {group: number for number, group in enumerate(groups)}
    return sorted(
        rows, key=lambda row: (place[row["scenario"], row["sensor"]], row["estimator"] == FLOOR)
    )


def _bars(table: pd.DataFrame, metric: MetricDeclaration) -> list[Bar]:
    """Bars of a metric for the leaderboard's rows, on one logarithmic scale."""
    columns = [f"{metric.name}_{name}" for name in ("q25", "median", "q75")]
    values = table[columns].to_numpy(float)
    logs = [[_log(v) for v in row] for row in values]
    finite = [v for row in logs for v in row if math.isfinite(v)]
    low, high = min(finite, default=0.0), max(finite, default=1.0)
    scale = 100 / max(high - low, 1e-9)
    places = [[(v - low) * scale if math.isfinite(v) else None for v in row] for row in logs]
    return [Bar(100.0 if a is None else a, b, 100.0 if c is None else c) for a, b, c in places]


def _log(value: float) -> float:
    return math.log10(max(value, _SMALLEST_SHOWN)) if math.isfinite(value) else math.inf


def _weights(tables: RunTables) -> list[dict[str, Any]]:
    """Rows of the identifiability table, with ratios to the bound and what noise leaves."""
    key = ["scenario", "sensor", "player", "weight"]
    ratios: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in table_rows(tables.bound_ratios):
        ratios.setdefault(tuple(row[k] for k in key), {})[row["estimator"]] = row
    noise: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in table_rows(tables.identifiability_by_noise.sort_values("sigma")):
        noise.setdefault(tuple(row[k] for k in key), []).append(row)
    rows = []
    for row in table_rows(tables.identifiability):
        place = tuple(row[k] for k in key)
        levels = noise.get(place, [])
        ends = levels if len(levels) < 2 else [levels[0], levels[-1]]
        rows.append(row | {"ratios": ratios.get(place, {}), "noise": ends})
    return rows

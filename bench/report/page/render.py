"""The page out of its parts."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.measures import in_leaderboard, primary
from olne_bench.bench.report.page.data import chart_data
from olne_bench.bench.report.page.numbers import human
from olne_bench.bench.report.page.verdicts import verdicts
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.bench.report.statistics.estimator_comparison import SIGNIFICANCE, leaders
from olne_bench.bench.report.statistics.harness_errors import in_words
from olne_bench.bench.report.statistics.identifiability import REFERENCE_SIGMA
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.bench.report.tables import RunTables
from olne_bench.bench.run.provenance import Provenance

_FOLDER = Path(__file__).parent
_SMALLEST_SHOWN = 1e-6  # of errors on bars


@dataclass(frozen=True)
class Bar:
    """A median and its quartiles on a scale from 0 to 100; None where it is infinite."""

    low: float
    mid: float | None
    high: float


@dataclass(frozen=True)
class Page:
    """The page.

    Attributes:
        html: all of it.
        notes: what it could not show, and why.
    """

    html: str
    notes: list[str]


def render_page(
    trials: pd.DataFrame,
    tables: RunTables,
    runs: Sequence[Provenance],
    study: Study = USUAL,
    notes: Sequence[str] = (),
) -> Page:
    """The page as HTML.

    Args:
        trials: rows of a run.
        tables: made of them.
        runs: where the rows come from, the last one last.
        study: of the run.
        notes: what else could not be shown, which the page says as well.
    """
    table = tables.leaderboard
    charts = chart_data(trials, study)
    metrics = in_leaderboard(study.metrics, table)
    first = primary(metrics)
    html = _template().render(
        title=str(trials["suite"].iloc[0]),
        description=_description(runs),
        css=_own("page.css"),
        script=_own("page.js"),
        data=charts.content,
        colours={n: style.estimator_colours(n) for n in table["estimator"].unique()},
        verdicts=verdicts(table, tables.comparisons, study),
        rows=_board(table, metrics, first),
        metrics=metrics,
        primary=first,
        comparisons=_rows(tables.comparisons),
        weights=_weights(tables),
        trial_count=int(table["trials"].sum()),
        harness_errors=in_words(tables.harness_errors),
        notes=list(dict.fromkeys([*notes, *charts.notes])),
        runs=list(runs),
        written=datetime.now(UTC).isoformat(sep=" ", timespec="minutes"),
        sigma=REFERENCE_SIGMA,
        significance=SIGNIFICANCE,
        floor=FLOOR,
    )
    return Page(html, charts.notes)


def _template() -> Template:
    environment = Environment(
        loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters |= {
        "human": human,
        "percent": _percent,
        "chance": _chance,
        "key": _sort_key,
        "moment": _moment,
    }
    return environment.get_template("template.html")


def _own(name: str) -> Markup:
    """A file of ours, which goes into the page as it is."""
    return Markup((_FOLDER / name).read_text(encoding="utf-8"))


def _description(runs: Sequence[Provenance]) -> str:
    """The suite's own line, where it is known."""
    return str(json.loads(runs[-1].suite).get("description", "")) if runs else ""


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(k): v for k, v in row.items()} for row in table.to_dict("records")]


def _board(
    table: pd.DataFrame, metrics: Sequence[MetricDeclaration], first: MetricDeclaration | None
) -> list[dict[str, Any]]:
    """Rows of the leaderboard with their bars, the floor below those that it measures."""
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
    rows = [row | {"bar": bar} for row, bar in zip(_rows(table), bars, strict=True)]
    groups = list(dict.fromkeys((row["scenario"], row["sensor"]) for row in rows))
    place = {group: number for number, group in enumerate(groups)}
    return sorted(
        rows, key=lambda row: (place[row["scenario"], row["sensor"]], row["estimator"] == FLOOR)
    )


def _bars(table: pd.DataFrame, metric: MetricDeclaration) -> list[Bar]:
    """A metric of the leaderboard's rows on one logarithmic scale."""
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
    """Identifiability, each row with the estimators' ratios to the bound."""
    key = ["scenario", "sensor", "player", "weight"]
    ratios: dict[tuple[Any, ...], dict[str, float]] = {}
    for row in _rows(tables.bound_ratios):
        ratios.setdefault(tuple(row[k] for k in key), {})[row["estimator"]] = row["ratio"]
    return [
        row | {"ratios": ratios.get(tuple(row[k] for k in key), {})}
        for row in _rows(tables.identifiability)
    ]


def _percent(share: float) -> str:
    return "–" if math.isnan(share) else f"{100 * share:.3g} %"


def _chance(p: float) -> str:
    """A p-value for people."""
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


def _moment(text: str) -> str:
    """A time as stored, for people."""
    return f"{datetime.fromisoformat(text).astimezone(UTC):%Y-%m-%d %H:%M} UTC"


def _sort_key(value: float) -> str:
    """A number as the script's sorting reads it; empty where there is none."""
    value = float(value)
    return "" if math.isnan(value) else repr(value).replace("inf", "Infinity")

"""The page out of its parts."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from olne_bench.bench.report.figures import style
from olne_bench.bench.report.page.data import chart_data
from olne_bench.bench.report.page.numbers import human
from olne_bench.bench.report.page.verdicts import verdicts
from olne_bench.bench.report.results import Findings
from olne_bench.bench.report.statistics.attempts import ERRORS, FLOOR
from olne_bench.bench.report.statistics.estimator_comparison import SIGNIFICANCE, leaders
from olne_bench.bench.report.statistics.identifiability import REFERENCE_SIGMA
from olne_bench.bench.run.provenance import Provenance

_FOLDER = Path(__file__).parent
_SMALLEST_SHOWN = 1e-6  # of errors on bars


@dataclass(frozen=True)
class Bar:
    """A median and its quartiles on a scale from 0 to 100; None where it is infinite."""

    low: float
    mid: float | None
    high: float


def render_page(
    trials: pd.DataFrame,
    findings: Findings,
    runs: Sequence[Provenance],
) -> str:
    """The page as HTML.

    Args:
        trials: rows of a run.
        findings: its tables.
        runs: where the rows come from, the last one last.
    """
    table = findings.leaderboard
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
    return environment.get_template("template.html").render(
        title=str(trials["suite"].iloc[0]),
        description=_description(runs),
        css=_own("page.css"),
        script=_own("page.js"),
        data=chart_data(trials),
        colours=style.estimator_colours(table["estimator"].unique().tolist()),
        verdicts=verdicts(table, findings.comparisons),
        rows=_board(table),
        shows={
            "held_out": "held_out_error_median" in table,
            "coverage": bool(table["coverage"].notna().any()),
        },
        comparisons=_rows(findings.comparisons),
        weights=_weights(findings),
        trial_count=int(table["trials"].sum()),
        runs=list(runs),
        written=datetime.now(UTC).isoformat(sep=" ", timespec="minutes"),
        sigma=REFERENCE_SIGMA,
        significance=SIGNIFICANCE,
        floor=FLOOR,
    )


def _own(name: str) -> Markup:
    """A file of ours, which goes into the page as it is."""
    return Markup((_FOLDER / name).read_text(encoding="utf-8"))


def _description(runs: Sequence[Provenance]) -> str:
    """The suite's own line, where it is known."""
    return str(json.loads(runs[-1].suite).get("description", "")) if runs else ""


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(k): v for k, v in row.items()} for row in table.to_dict("records")]


def _board(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of the leaderboard with their bars, the floor below those that it measures."""
    ranked = table["position_error_rank"].astype("Float64").to_numpy(float, na_value=math.nan)
    table = table.assign(
        position_error_rank=ranked,
        **{f"{error}_leads": leaders(table, error) for error in ERRORS},
    )
    rows = [row | {"bar": bar} for row, bar in zip(_rows(table), _bars(table), strict=True)]
    groups = list(dict.fromkeys((row["scenario"], row["view"]) for row in rows))
    place = {group: number for number, group in enumerate(groups)}
    return sorted(
        rows, key=lambda row: (place[row["scenario"], row["view"]], row["estimator"] == FLOOR)
    )


def _bars(table: pd.DataFrame) -> list[Bar]:
    """Position errors of the leaderboard's rows on one logarithmic scale."""
    columns = [f"position_error_{name}" for name in ("q25", "median", "q75")]
    values = table[columns].to_numpy(float)
    logs = [[_log(v) for v in row] for row in values]
    finite = [v for row in logs for v in row if math.isfinite(v)]
    low, high = min(finite, default=0.0), max(finite, default=1.0)
    scale = 100 / max(high - low, 1e-9)
    places = [[(v - low) * scale if math.isfinite(v) else None for v in row] for row in logs]
    return [Bar(100.0 if a is None else a, b, 100.0 if c is None else c) for a, b, c in places]


def _log(value: float) -> float:
    return math.log10(max(value, _SMALLEST_SHOWN)) if math.isfinite(value) else math.inf


def _weights(findings: Findings) -> list[dict[str, Any]]:
    """Identifiability, each row with the estimators' ratios to the bound."""
    key = ["scenario", "view", "player", "weight"]
    ratios: dict[tuple[Any, ...], dict[str, float]] = {}
    for row in _rows(findings.bound_ratios):
        ratios.setdefault(tuple(row[k] for k in key), {})[row["estimator"]] = row["ratio"]
    return [
        row | {"ratios": ratios.get(tuple(row[k] for k in key), {})}
        for row in _rows(findings.identifiability)
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

"""The leaderboard as text: for a terminal, a README (Markdown) and a paper (LaTeX)."""

import math
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.board import board_note, board_table, errors_of_board, tag, verdict
from olne_bench.bench.report.escapes import markdown_text
from olne_bench.bench.report.statistics.attempts import in_words
from olne_bench.bench.report.statistics.standing import said_of_standing
from olne_bench.bench.report.study import USUAL, Study, in_leaderboard, primary
from olne_bench.bench.report.tables import RunTables
from olne_bench.bench.text import clip, one_line

_PLACE = ["scenario", "sensor", "estimator"]
_WIDTH = 88  # of lines in a terminal
_ROUNDING = 1e-9  # errors below this are rounding of solvers


@dataclass(frozen=True)
class _Markup:
    """How a language writes cells."""

    number: Callable[[float], str]  # may be infinite or missing
    bold: Callable[[str], str]
    text: Callable[[str], str]  # a name, whose special characters it escapes


def markdown(table: pd.DataFrame, study: Study = USUAL) -> str:
    """The leaderboard as a Markdown table, its best scores in bold, and who does not rank."""
    shown = _shown(table, study, _Markup(_plain, "**{}**".format, markdown_text))
    rule = ["---" if k < 3 else "---:" for k in range(len(shown.columns))]
    lines = [list(shown.columns), rule, *shown.to_numpy().tolist()]
    said = "".join(f"\n{markdown_text(line)}\n" for line in said_of_standing(table))
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + said


def latex(table: pd.DataFrame, study: Study = USUAL) -> str:
    """The leaderboard as a LaTeX ``tabular``, for the package booktabs."""
    shown = _shown(table, study, _Markup(_mathematical, "\\textbf{{{}}}".format, _latex_text))
    kinds = "l" * 3 + "r" * (len(shown.columns) - 3)
    return shown.style.hide(axis="index").to_latex(column_format=kinds, hrules=True)


def format_board(tables: RunTables, study: Study = USUAL) -> str:
    """The board for a terminal: the verdict, a row for each estimator, and what is shown."""
    rows = board_table(tables, study)
    tags = [tag(row, study) for row in rows.to_dict("records")]
    named = zip(rows["estimator"].map(one_line), tags, strict=True)
    columns: dict[str, Any] = {"Estimator": [f"{n} ({t})" if t else n for n, t in named]}
    scores = rows[["score", "score_low", "score_high"]].itertuples(index=False)
    columns["Score"] = [
        _plain(score) if math.isnan(ends[0]) else _with_ends(*map(_plain, (score, *ends)))
        for score, *ends in scores
    ]
    for name, head in errors_of_board(tables, study).items():
        columns[head] = rows[name].map(_plain)
    counts = rows[["failures", "trials"]].itertuples(index=False)
    columns["Failures"] = [f"{failed} / {trials}" for failed, trials in counts]
    columns["Time [ms]"] = rows["milliseconds"].map(_plain)
    said = verdict(tables.scores, tables.comparisons, study)
    shown = pd.DataFrame(columns).to_string(index=False)
    note = board_note(rows, study)
    return "\n\n".join([textwrap.fill(said, _WIDTH), shown, textwrap.fill(note, _WIDTH)])


def _with_ends(middle: str, low: str, high: str) -> str:
    return f"{middle} [{low}, {high}]"


def format_notes(tables: RunTables, notes: list[str]) -> str:
    """Who does not rank, errors of the harness, what could not be drawn, and why, if anything."""
    wrong, failed = in_words(tables.harness_errors), in_words(tables.failures, most=3)
    parts = [
        ("Not ranked, or too good:", said_of_standing(tables.leaderboard)),
        ("The harness itself failed; these trials do not count as attempts:", wrong),
        ("Why trials failed:", [clip(line) for line in failed]),
        ("Not shown, and why:", notes),
    ]
    return "\n".join(
        "\n".join([head, *(f"  {n}" for n in lines)]) for head, lines in parts if lines
    )


def format_summary(heading: str, summary: pd.DataFrame, failed: pd.DataFrame, unit: str) -> str:
    """What a summary of streams or drives holds, its columns, and which ``unit`` failed in it."""
    shown = summary.to_string(index=False, float_format=lambda v: f"{v:.3g}", na_rep="-")
    reasons = failed.groupby(["status", "message"])
    told = [f"{len(part)} {unit} {status}: {message}" for (status, message), part in reasons]
    return "\n".join([heading, shown, *told])


def _shown(table: pd.DataFrame, study: Study, markup: _Markup) -> pd.DataFrame:
    """All cells and column heads as text of the language."""
    number, text = markup.number, markup.text
    columns: dict[str, Any] = {name.capitalize(): table[name].map(text) for name in _PLACE}
    metrics = in_leaderboard(study.metrics, table)
    first = primary(metrics)
    if first is not None and f"{first.name}_score" in table:
        scores = table[f"{first.name}_score"]
        best = scores == scores.groupby([table["scenario"], table["sensor"]]).transform("min")
        columns["Score"] = scores.map(number).mask(best, scores.map(number).map(markup.bold))
    for metric in metrics:
        columns[text(metric.title)] = _cells(table, metric, markup)
    for head, name in (("Exact", "exact"), ("No fit", "refuted")):
        if name in table and table[name].notna().any():
            shares = table[name]
            columns[head] = [number(v) if math.isnan(v) else text(f"{v:.0%}") for v in shares]
    columns[text("Error / bound")] = table["limit_ratio"].map(number)
    counts = table[["failures", "published_failures", "trials"]].itertuples(index=False)
    columns["Failures (published)"] = [f"{a} ({b}) of {n}" for a, b, n in counts]
    for head, name in (("Harness errors", "harness_errors"), ("Implausible", "implausible")):
        if name in table and (table[name] > 0).any():
            columns[head] = table[name].astype("string")
    columns[text("Time [ms]")] = (1e3 * table["solve_seconds_median"]).map(number)
    return pd.DataFrame(columns, index=table.index)


def _cells(table: pd.DataFrame, metric: MetricDeclaration, markup: _Markup) -> list[str]:
    """A share with its number of trials, a compared error with its quartiles, else a median."""
    number = markup.number
    if metric.is_share:
        told = zip(table[f"{metric.name}_share"], table[f"{metric.name}_trials"], strict=True)
        return [markup.text(f"{v:.0%} of {n}") if n else number(math.nan) for v, n in told]
    if not metric.compared:
        return [number(value) for value in table[f"{metric.name}_median"]]
    quartiles = table[[f"{metric.name}_{name}" for name in ("median", "q25", "q75")]].map(number)
    return [_with_ends(*told) for told in quartiles.itertuples(index=False)]


def _plain(value: float) -> str:
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    if abs(value) < _ROUNDING:
        return "0"
    if abs(value) >= 99.5:
        return f"{value:.0f}"
    return np.format_float_positional(float(f"{value:.2g}"), trim="-")


def _mathematical(value: float) -> str:
    if math.isnan(value):
        return "--"
    return "$\\infty$" if math.isinf(value) else _plain(value)


_NAMED = {"\\": "backslash", "~": "asciitilde", "^": "asciicircum"}
_NAMED |= {"<": "less", ">": "greater", "|": "bar"}
_LATEX = {c: f"\\text{name}{{}}" for c, name in _NAMED.items()} | {c: f"\\{c}" for c in "&%$#_{}"}


def _latex_text(text: str) -> str:
    """A name with LaTeX's special characters escaped."""
    return "".join(_LATEX.get(c, c) for c in one_line(text))

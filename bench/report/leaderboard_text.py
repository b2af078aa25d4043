"""The leaderboard as text: for a terminal, a README (Markdown) and a paper (LaTeX)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.escapes import markdown_text
from olne_bench.bench.report.statistics.attempts import in_words
from olne_bench.bench.report.statistics.standing import said_of_standing
from olne_bench.bench.report.study import USUAL, Study, in_leaderboard, primary
from olne_bench.bench.report.tables import RunTables
from olne_bench.bench.text import one_line

_PLACE = ["scenario", "sensor", "estimator"]
_ROUNDING = 1e-9  # errors below this are rounding of solvers
_LEGEND = """
Medians and quartiles [IQR] are over all trials; a failure counts as infinitely wrong.
Failures (published): also those where the published search misses a root that another one finds."""
_LEGEND_OF_SCORES = """
Score: geometric mean of the {metric} over that of the paper's method in the same trials with noise;
0.79 is 21 % smaller. A failure counts as the error of uniform. Without a score: see 'Not ranked'.
Exact: share of trials without noise that predict within 1 mm.
No fit: share of noisy trials whose residuals noise does not explain; 1 % if the model is true.
/ bound: mean cosine error over its statistical limit (the Cramer-Rao bound) at little noise.
Time: median of one estimate; those that were stopped or broke off count as infinitely slow."""
_FLOOR_LEGEND = """
uniform is the floor: equal weights, which are the published ones of two_player."""


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


def format_leaderboard(table: pd.DataFrame, study: Study = USUAL) -> str:
    """The leaderboard for a terminal, with a legend."""
    shown = _shown(table, study, _Markup(_plain, str, one_line))
    metrics = in_leaderboard(study.metrics, table)
    told = "".join(f"\n{m.title}: {m.description or 'its median.'}" for m in metrics)
    first = primary(metrics)
    scores = _LEGEND_OF_SCORES.format(metric=first.label) if first else ""
    floor = _FLOOR_LEGEND if any(map(study.is_floor, table["estimator"])) else ""
    return f"{shown.to_string(index=False)}\n{_LEGEND}{told}{scores}{floor}"


def format_notes(tables: RunTables, notes: list[str]) -> str:
    """Who does not rank, errors of the harness, what could not be drawn, and why, if anything."""
    wrong = in_words(tables.harness_errors)
    parts = [
        ("Not ranked, or too good:", said_of_standing(tables.leaderboard)),
        ("The harness itself failed; these trials do not count as attempts:", wrong),
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
        columns["Score"] = _scores(table, f"{first.name}_score", markup)
    for metric in metrics:
        columns[text(metric.title)] = _cells(table, metric, markup)
    if "exact" in table and table["exact"].notna().any():
        exact = [number(v) if math.isnan(v) else text(f"{v:.0%}") for v in table["exact"]]
        columns["Exact"] = exact
    if "refuted" in table and table["refuted"].notna().any():
        refuted = [number(v) if math.isnan(v) else text(f"{v:.0%}") for v in table["refuted"]]
        columns["No fit"] = refuted
    columns[text("Error / bound")] = table["limit_ratio"].map(number)
    counts = table[["failures", "published_failures", "trials"]].itertuples(index=False)
    columns["Failures (published)"] = [f"{a} ({b}) of {n}" for a, b, n in counts]
    for head, name in (("Harness errors", "harness_errors"), ("Implausible", "implausible")):
        if name in table and (table[name] > 0).any():
            columns[head] = table[name].astype("string")
    columns[text("Time [ms]")] = (1e3 * table["solve_seconds_median"]).map(number)
    return pd.DataFrame(columns, index=table.index)


def _scores(table: pd.DataFrame, column: str, markup: _Markup) -> pd.Series:
    """Scores, the best one of a scenario and sensor in bold."""
    best = table[column] == table.groupby(_PLACE[:2])[column].transform("min")
    shown = table[column].map(markup.number)
    return shown.mask(best, shown.map(markup.bold))


def _cells(table: pd.DataFrame, metric: MetricDeclaration, markup: _Markup) -> list[str]:
    """A share with its number of trials, a compared error with its quartiles, else a median."""
    number = markup.number
    if metric.is_share:
        told = zip(table[f"{metric.name}_share"], table[f"{metric.name}_trials"], strict=True)
        return [markup.text(f"{v:.0%} of {n}") if n else number(math.nan) for v, n in told]
    if not metric.compared:
        return [number(value) for value in table[f"{metric.name}_median"]]
    quartiles = table[[f"{metric.name}_{name}" for name in ("median", "q25", "q75")]].map(number)
    return [f"{middle} [{low}, {high}]" for middle, low, high in quartiles.itertuples(index=False)]


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

"""The leaderboard for a paper or a README: LaTeX and Markdown."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.escapes import markdown_text
from olne_bench.bench.report.measures import in_leaderboard, primary
from olne_bench.bench.report.statistics.estimator_comparison import leaders
from olne_bench.bench.report.statistics.standing import said_of_standing
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.bench.text import one_line

_ROUNDING = 1e-9  # errors below this are rounding of solvers


@dataclass(frozen=True)
class _Markup:
    """How a language writes cells.

    Attributes:
        number: writes a number, which may be infinite or missing.
        bold: writes text in bold.
        text: writes a name, with the language's special characters escaped.
    """

    number: Callable[[float], str]
    bold: Callable[[str], str]
    text: Callable[[str], str]


def markdown(table: pd.DataFrame, study: Study = USUAL) -> str:
    """The leaderboard as a Markdown table; the leaders of a scenario and sensor are bold.

    Sentences on who does not rank, if there are any, follow it.
    """
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


def _shown(table: pd.DataFrame, study: Study, markup: _Markup) -> pd.DataFrame:
    """All cells and column heads as text of the language."""
    number, text = markup.number, markup.text
    columns = {
        head: table[name].map(text)
        for head, name in (
            ("Scenario", "scenario"),
            ("Sensor", "sensor"),
            ("Estimator", "estimator"),
        )
    }
    metrics = in_leaderboard(study.metrics, table)
    first = primary(metrics)
    if first is not None and f"{first.name}_rank" in table:
        ranked = table[f"{first.name}_rank"].astype("string")
        columns["Rank"] = ranked.fillna(number(math.nan))
    for metric in metrics:
        columns[text(metric.title)] = pd.Series(_cells(table, metric, markup), table.index)
    columns[text("Error / bound")] = table["limit_ratio"].map(number)
    counts = table[["failures", "published_failures", "trials"]].itertuples(index=False)
    failures = [f"{a} ({b}) of {n}" for a, b, n in counts]
    columns["Failures (published)"] = pd.Series(failures, table.index)
    for head, name in (("Harness errors", "harness_errors"), ("Implausible", "implausible")):
        if name in table and (table[name] > 0).any():
            columns[head] = table[name].astype("string")
    columns[text("Time [ms]")] = (1e3 * table["solve_seconds_median"]).map(number)
    return pd.DataFrame(columns)


def _cells(table: pd.DataFrame, metric: MetricDeclaration, markup: _Markup) -> list[str]:
    """A share with its number of trials, a compared error with its quartiles, else a median."""
    number = markup.number
    if metric.is_share:
        told = table[[f"{metric.name}_share", f"{metric.name}_trials"]].itertuples(index=False)
        return [
            markup.text(f"{share:.0%} of {count}") if count else number(math.nan)
            for share, count in told
        ]
    if not metric.compared:
        return [number(value) for value in table[f"{metric.name}_median"]]
    quartiles = table[[f"{metric.name}_{name}" for name in ("median", "q25", "q75")]]
    best = (
        leaders(table, metric.name).tolist()
        if f"{metric.name}_rank" in table
        else [False] * len(table)
    )
    return [
        (markup.bold(number(middle)) if leads else number(middle))
        + f" [{number(low)}, {number(high)}]"
        for (middle, low, high), leads in zip(quartiles.itertuples(index=False), best, strict=True)
    ]


def _plain(value: float) -> str:
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    if abs(value) < _ROUNDING:
        return "0"
    return (
        f"{value:.0f}"
        if abs(value) >= 99.5
        else np.format_float_positional(float(f"{value:.2g}"), trim="-")
    )


def _mathematical(value: float) -> str:
    if math.isnan(value):
        return "--"
    if math.isinf(value):
        return "$\\infty$"
    return _plain(value)


_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
} | {c: f"\\{c}" for c in "&%$#_{}"}


def _latex_text(text: str) -> str:
    """A name with LaTeX's special characters escaped."""
    return "".join(_LATEX.get(c, c) for c in one_line(text))

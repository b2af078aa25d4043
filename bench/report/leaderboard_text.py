"""The leaderboard for a paper or a README: LaTeX and Markdown."""

import math

import numpy as np
import pandas as pd

from olne_bench.bench.report.statistics.estimator_comparison import leaders

_ERRORS = {
    "position_error": "Position error [m]",
    "cosine_error": "Cosine error",
}
_ROUNDING = 1e-9  # below, errors are a solver's rounding


def markdown(table: pd.DataFrame) -> str:
    """The leaderboard as a Markdown table; the leaders of a scenario and view are bold."""
    shown = _shown(table, number=_plain, bold="**{}**".format, percent="%")
    for column in ("Scenario", "View", "Estimator"):
        shown[column] = [_markdown_text(text) for text in shown[column]]
    texts = ("Scenario", "View", "Estimator")
    rule = ["---" if column in texts else "---:" for column in shown]
    lines = [list(shown.columns), rule, *shown.to_numpy().tolist()]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def latex(table: pd.DataFrame) -> str:
    """The leaderboard as a LaTeX ``tabular``, for the package booktabs."""
    shown = _shown(table, number=_mathematical, bold="\\textbf{{{}}}".format, percent="\\%")
    style = shown.style.hide(axis="index")
    style = style.format(escape="latex", subset=["Scenario", "View", "Estimator"])
    kinds = "l" * 3 + "r" * (len(shown.columns) - 3)
    return style.to_latex(column_format=kinds, hrules=True)


def _shown(  # type: ignore[no-untyped-def]
    table: pd.DataFrame, *, number, bold, percent: str
) -> pd.DataFrame:
    shown = pd.DataFrame(
        {
            "Scenario": table["scenario"],
            "View": table["view"],
            "Estimator": table["estimator"],
            "Rank": table["position_error_rank"].astype("string").fillna(number(math.nan)),
        }
    )
    for error, title in _ERRORS.items():
        columns = [f"{error}_{name}" for name in ("median", "q25", "q75")]
        texts = [
            (number(middle), f" [{number(low)}, {number(high)}]")
            for middle, low, high in table[columns].itertuples(index=False)
        ]
        shown[title] = [
            (bold(middle) if best else middle) + rest
            for (middle, rest), best in zip(texts, leaders(table, error), strict=True)
        ]
    if "held_out_error_median" in table:
        shown["Held out [m]"] = table["held_out_error_median"].map(number)
    shown["Identifiable"] = table["identifiable_cosine_error_median"].map(number)
    shown["Error / bound"] = table["limit_ratio"].map(number)
    covered = table[["coverage", "coverage_trials"]].itertuples(index=False)
    shown["Covered"] = [
        f"{share:.0%} of {count}".replace("%", percent) if count else number(math.nan)
        for share, count in covered
    ]
    counts = table[["failures", "published_failures", "trials"]].itertuples(index=False)
    shown["Failures (published)"] = [f"{a} ({b}) of {n}" for a, b, n in counts]
    shown["Time [ms]"] = (1e3 * table["solve_seconds_median"]).map(number)
    return shown


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


def _markdown_text(text: str) -> str:
    """A name as text: nothing that Markdown, or HTML in it, would act on."""
    return "".join(f"\\{c}" if c in "\\`*_[]<>|#&" else c for c in text)

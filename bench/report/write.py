"""What a run leaves to take home: tables and figures, made from the store alone."""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pandas as pd
from pyarrow import csv, parquet

from olne_bench.bench.report.figures import draw_figures
from olne_bench.bench.report.leaderboard_text import latex, markdown
from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.results import find
from olne_bench.bench.report.statistics.attempts import FLOOR, weighed
from olne_bench.bench.run.store import read_store
from olne_bench.bench.run.store_table import parse_weights, to_frame
from olne_bench.errors import UserError
from olne_bench.files import whole_file

_LEGEND = """
Medians and quartiles [IQR] are over all trials; a failure counts as infinitely wrong.
published_failures: also those where the published search misses a root that another one finds.
cosine error: angle between estimated and true weights; position error [m]: prediction by the
forward game at the estimated weights; held out: its median from five other initial states.
covered: share of the estimates' 95 % ellipsoids that hold the true weights.
identifiable: median cosine error less what the data cannot show at 0.01 m.
rank: by position error; differences that are not significant are ties, and where so few trials
are independent that none could be, there is none. /limit: mean cosine error
over its statistical limit (the Cramer-Rao bound) at little noise. ms: median time of one
estimate; those that were stopped or broke off count as infinitely slow."""
_FLOOR_LEGEND = """
uniform is the floor: equal weights. In two_player the true weights happen to be equal."""


def write_report(folder: Path, formats: Sequence[str]) -> pd.DataFrame:
    """Write tables, as CSV, the page ``index.html`` and ``figures/``.

    The tables are ``trials`` (also as Parquet), ``leaderboard``, ``comparisons`` (of estimators,
    in pairs), ``identifiability`` and ``bound_ratios`` (of weights); the leaderboard comes in
    Markdown and LaTeX, too.

    Args:
        folder: a run folder.
        formats: of the figures; none are drawn where it is empty.

    Returns:
        The leaderboard.

    Raises:
        UserError: if the folder holds no run, or cannot be written.
    """
    with read_store(folder) as store:
        rows, runs = store.table(), store.runs()
    if not rows.num_rows:
        raise UserError(f"the run in {folder} has no finished trial yet")
    try:
        with whole_file(folder / "trials.csv") as path:
            csv.write_csv(rows, path)
        rows = parse_weights(rows)
        with whole_file(folder / "trials.parquet") as path:
            parquet.write_table(rows, path, compression="zstd")
        trials = weighed(to_frame(rows))
        findings = find(trials)
        for name, table in findings.tables().items():
            with whole_file(folder / f"{name}.csv") as path:
                table.to_csv(path, index=False)
        for name, text in (
            ("leaderboard.md", markdown(findings.leaderboard)),
            ("leaderboard.tex", latex(findings.leaderboard)),
        ):
            with whole_file(folder / name) as path:
                path.write_text(text, encoding="utf-8")
        with whole_file(folder / "index.html") as path:
            page = render_page(trials, findings, runs)
            path.write_text(page, encoding="utf-8")
        if formats:
            draw_figures(trials, folder / "figures", formats)
    except OSError as error:
        raise UserError(f"cannot write to {folder}: {error.strerror or error}") from error
    return findings.leaderboard


def format_leaderboard(table: pd.DataFrame) -> str:
    """The leaderboard as text for a terminal."""
    counts = ["trials", "failures", "published_failures"]
    shown = table[["scenario", "view", "estimator", *counts]].copy()
    for error in ("cosine_error", "position_error"):
        quartiles = table[[f"{error}_median", f"{error}_q25", f"{error}_q75"]]
        shown[f"{error.replace('_', ' ')} [IQR]"] = [
            f"{_short(median)} [{_short(low)}, {_short(high)}]"
            for median, low, high in quartiles.itertuples(index=False)
        ]
    if "held_out_error_median" in table:
        shown["held out"] = table["held_out_error_median"].map(_short)
    shown["covered"] = table["coverage"].map("{:.0%}".format).replace("nan%", "")
    if "identifiable_cosine_error_median" in table:
        shown["identifiable"] = table["identifiable_cosine_error_median"].map(_short)
    shown["/limit"] = table["limit_ratio"].map(partial(_short, digits=".2f"))
    shown["rank"] = table["position_error_rank"].astype("string").fillna("-")
    shown["ms"] = (1e3 * table["solve_seconds_median"]).map(partial(_short, digits=".1f"))
    legend = _LEGEND + (_FLOOR_LEGEND if FLOOR in set(table["estimator"]) else "")
    return f"{shown.to_string(index=False)}\n{legend}"


def _short(value: float, digits: str = ".2g") -> str:
    if math.isnan(value):
        return "-"
    return "∞" if math.isinf(value) else f"{value:{digits}}"

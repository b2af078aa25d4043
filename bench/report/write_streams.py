"""Write the report of a study of streams: tables, page and figures."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from olne_bench.bench.judge.streams import ERROR_COLUMNS
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.report.figures.streams import figures_of
from olne_bench.bench.report.leaderboard_text import format_summary
from olne_bench.bench.report.page.streams import OnlineTables, online_page
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.stream_tables import (
    comparison_table,
    over_time_table,
    summary_table,
    update_table,
)
from olne_bench.bench.report.write import write_figures, write_text
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import last_suite
from olne_bench.bench.run.store import read_store
from olne_bench.errors import UserError

#: Digits of medians and of ends of intervals.
_DIGITS = "%.4g"
#: Columns of the summary that are shown, in the order of the terminal.
_SHOWN = ["scenario", "sigma", "estimator", "motions", "failed", "late", "latency_50", "latency_99"]
_SHOWN += ["cosine_error", "half_time", *(n for n in ERROR_COLUMNS if n.startswith("fde_"))]


def report_streams(folder: Path, formats: Sequence[str]) -> str:
    """Write the report of the run in a folder; what a terminal shows of it.

    Args:
        folder: a run folder.
        formats: formats of the figures; if empty, none is drawn.

    Raises:
        UserError: if the folder holds no such run, or cannot be written.
    """
    with read_store(folder) as store:
        runs = store.runs()
        suite = last_suite(runs, folder)
        rows = update_table(store, suite)
    if attempts_of(rows).empty:
        why = next(iter(rows["message"]), "")
        raise UserError(f"no motion was followed in {folder} yet{f': {why}' if why else ''}")
    summary = write_online(rows, runs, suite, folder, formats).summary
    failed = rows[(rows["status"] != "ok") & ~rows["estimator"].isin(suite.references)]
    heading = "medians; latency in ms, half_time in s, errors of positions (fde) in m"
    said = format_summary(heading, summary[_SHOWN], failed, "rows")
    return f"{said}\n{folder}: index.html is the page, updates.csv has a row for each sample"


def write_online(
    rows: pd.DataFrame,
    runs: Sequence[Provenance],
    suite: Suite,
    folder: Path,
    formats: Sequence[str],
) -> OnlineTables:
    """Write ``updates``, ``summary``, ``over_time`` and ``comparisons`` as CSV and ``index.html``.

    Args:
        rows: rows of updates, as ``update_table`` makes them.
        runs: provenance of the rows, the latest run last.
        suite: suite of the latest run.
        folder: where files go.
        formats: formats of ``figures/online_*``; if empty, none is drawn.
    """
    tables = OnlineTables(summary_table(rows), over_time_table(rows), comparison_table(rows))
    write_csv(rows, folder / "updates.csv")
    for name, table in tables.by_name().items():
        write_csv(table, folder / f"{name}.csv", _DIGITS)
    pictures = write_figures(figures_of(rows), folder / "figures", formats)
    write_text(folder / "index.html", online_page(tables, pictures, runs, suite))
    return tables

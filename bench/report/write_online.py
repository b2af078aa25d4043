"""Write the report of an online study: tables, page and figures."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from olne_bench.bench.plan.motion import OnlineRules
from olne_bench.bench.report.escapes import csv_safe
from olne_bench.bench.report.figures.online import draw_online
from olne_bench.bench.report.online import comparison_table, over_time_table, summary_table
from olne_bench.bench.report.page.online import OnlineTables, online_page
from olne_bench.bench.run.provenance import Provenance
from olne_bench.files import whole_file

#: Digits of medians and of ends of intervals.
_DIGITS = "%.4g"


def write_online(
    rows: pd.DataFrame,
    runs: Sequence[Provenance],
    rules: OnlineRules,
    folder: Path,
    *,
    figures: bool,
) -> OnlineTables:
    """Write ``updates``, ``summary``, ``over_time`` and ``comparisons`` as CSV and ``index.html``.

    Args:
        rows: rows of updates, as ``online_rows.update_table`` makes them.
        runs: provenance of the rows, the latest run last.
        rules: rules of the study.
        folder: where files go.
        figures: whether to draw ``online_*.png`` and ``.svg``, too.
    """
    tables = OnlineTables(summary_table(rows), over_time_table(rows), comparison_table(rows))
    for name, table, numbers in [
        ("updates", rows, None),
        *((name, table, _DIGITS) for name, table in tables.by_name().items()),
    ]:
        with whole_file(folder / f"{name}.csv") as path:
            csv_safe(table).to_csv(path, index=False, float_format=numbers)
    with whole_file(folder / "index.html") as path:
        path.write_text(online_page(tables, runs, rules), encoding="utf-8")
    if figures:
        draw_online(rows, folder)
    return tables

"""Write the report of a study of drives: tables, page and figures."""

from collections.abc import Sequence
from pathlib import Path

from olne_bench.bench.report.drive_tables import comparison_table, drive_table, episode_table
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.report.figures.drives import figures_of
from olne_bench.bench.report.leaderboard_text import format_summary
from olne_bench.bench.report.page.drives import driving_page
from olne_bench.bench.report.write import write_figures, write_text
from olne_bench.bench.run.resume import last_suite
from olne_bench.bench.run.store import read_store
from olne_bench.errors import UserError

_HEADING = "regret of the mean cost of a step (standing costs 1); medians in m, m/s^3, ms; shares"
_SHOWN = ["traffic", "road", "planner", "drives", "collisions", "regret", "progress", "jerk"]
_SHOWN += ["fde_3s", "cycle_50", "cycle_99", "fallback", "late"]


def report_drives(folder: Path, formats: Sequence[str]) -> str:
    """Write ``episodes``, ``summary`` and ``tests`` as CSV and ``index.html``; what is told of it.

    Args:
        folder: a run folder.
        formats: formats of ``figures/driving_*``; if empty, none is drawn.

    Raises:
        UserError: if the folder holds no such run or no drive was driven, or it cannot be written.
    """
    with read_store(folder) as store:
        runs = store.runs()
        suite = last_suite(runs, folder)
        rows = episode_table(store, suite)
    if rows.empty:
        raise UserError(f"the run in {folder} has no finished trial yet")
    write_csv(rows, folder / "episodes.csv")
    summary = drive_table(rows)
    if summary.empty:
        raise UserError(f"{folder}: no drive was driven; episodes.csv says why")
    tables = {"summary": summary, "tests": comparison_table(rows)}
    for name, table in tables.items():
        write_csv(table, folder / f"{name}.csv")
    pictures = write_figures(figures_of(summary), folder / "figures", formats)
    write_text(folder / "index.html", driving_page(tables, pictures, runs, suite))
    said = format_summary(_HEADING, summary[_SHOWN], rows[rows["status"] != "ok"], "drives")
    return f"{said}\n{folder}: index.html is the page, episodes.csv has a row for each drive"

"""Write the report of a run, of trials, streams or drives: tables, page and figures."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.report.figures import draw_figures, online, style
from olne_bench.bench.report.figures.beside import DrawnBeside
from olne_bench.bench.report.leaderboard_text import format_summary, latex, markdown
from olne_bench.bench.report.page.online import online_page
from olne_bench.bench.report.page.render import render_page
from olne_bench.bench.report.parts import write_trials
from olne_bench.bench.report.statistics.attempts import attempts_of
from olne_bench.bench.report.study import Study, study_in
from olne_bench.bench.report.tables import RunTables, tabulate
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import last_suite
from olne_bench.bench.run.store import Store, read_store
from olne_bench.errors import UserError
from olne_bench.files import whole_file

#: Columns of summaries that a terminal shows, in their order, and what they hold.
_OF_STREAMS = ["scenario", "sigma", "estimator", "motions", "failed", "late", "latency_50"]
_OF_STREAMS += ["latency_99", "cosine_error", "half_time"]
_STREAMS = "medians; latency in ms, half_time in s, errors of positions (fde) in m"
_OF_DRIVES = ["traffic", "road", "planner", "drives", "collisions", "regret", "progress", "jerk"]
_OF_DRIVES += ["fde_3s", "cycle_50", "cycle_99", "fallback", "late"]
_DRIVES = "regret of the mean cost of a step (standing costs 1); medians in m, m/s^3, ms; shares"
#: Digits of medians of streams and of ends of their intervals.
_DIGITS = "%.4g"


@dataclass(frozen=True)
class Report:
    """What was written of trials, and what could not be shown, and why."""

    tables: RunTables
    study: Study
    notes: list[str]


def write_report(
    folder: Path, formats: Sequence[str], playable: Sequence[tuple[float, int]] = ()
) -> Report:
    """Write ``trials`` and ``RunTables``, ``index.html`` and, if there are formats, ``figures/``.

    The page can play the trials of the ``playable`` noise levels and seeds. Only the trials of one
    scenario are in memory. UserError if there is no run in the folder.
    """
    with read_store(folder) as store:
        runs = store.runs()
        if next(store.batches(), None) is None:
            raise UserError(f"the run in {folder} has no finished trial yet")
        _refuse_unknown(store, playable)
        study = study_in(folder, store)
        trials = write_trials(store.batches(), folder)
    with DrawnBeside(trials, folder / "figures", formats, study) as beside:
        tables = tabulate(trials, study)
        _write_tables(tables.by_name(), folder)
        write_text(folder / "leaderboard.md", markdown(tables.leaderboard, study))
        write_text(folder / "leaderboard.tex", latex(tables.leaderboard, study))
        given = trials, tables, folder / "figures", formats, study
        pictures, lost = draw_figures(*given, beside.drawn)
    notes = [*tables.notes, *lost]
    page = render_page(trials, tables, runs, study, notes, playable=playable, pictures=pictures)
    write_text(folder / "index.html", page.html)
    return Report(tables, study, list(dict.fromkeys([*notes, *page.notes])))


def report_streams(folder: Path, formats: Sequence[str]) -> str:
    """Write the report of a study of streams; what a terminal shows of it, or UserError."""
    from olne_bench.bench.report import stream_tables  # trials need no judge of streams

    runs, suite, rows = _rows(folder, stream_tables.update_table)
    if attempts_of(rows).empty:
        why = next(iter(rows["message"]), "")
        raise UserError(f"no motion was followed in {folder} yet{f': {why}' if why else ''}")
    summary = write_streams(rows, runs, suite, folder, formats)
    failed = rows[(rows["status"] != "ok") & ~rows["estimator"].isin(suite.references)]
    said = format_summary(
        _STREAMS, summary[[*_OF_STREAMS, *summary.filter(regex=r"^fde_\d+s$")]], failed, "rows"
    )
    return f"{said}\n{folder}: index.html is the page, updates.csv has a row for each sample"


def write_streams(
    rows: pd.DataFrame,
    runs: Sequence[Provenance],
    suite: Suite,
    folder: Path,
    formats: Sequence[str],
) -> pd.DataFrame:
    """Write tables of rows of ``update_table``, page and ``figures/online_*``; the summary."""
    from olne_bench.bench.report import stream_tables

    tables = {
        "summary": stream_tables.summary_table(rows),
        "over_time": stream_tables.over_time_table(rows),
        "comparisons": stream_tables.comparison_table(rows),
    }
    write_csv(rows, folder / "updates.csv")
    _write_tables(tables, folder, _DIGITS)
    pictures = write_figures(online.stream_figures(rows), folder / "figures", formats)
    write_text(folder / "index.html", online_page(tables, pictures, runs, suite))
    return tables["summary"]


def report_drives(folder: Path, formats: Sequence[str]) -> str:
    """Write the report of a study of drives; what a terminal shows of it, or UserError."""
    # They import HighwayEnv, which takes long.
    from olne_bench.bench.report import drive_tables, encounter_tables

    runs, suite, rows = _rows(folder, drive_tables.episode_table)
    if rows.empty:
        raise UserError(f"the run in {folder} has no finished trial yet")
    write_csv(rows, folder / "episodes.csv")
    summary = drive_tables.drive_table(rows)
    if summary.empty:
        raise UserError(f"{folder}: no drive was driven; episodes.csv says why")
    tables = {"summary": summary, "tests": drive_tables.comparison_table(rows)}
    figures = online.drive_figures(summary)
    if suite.rules.contrasts:
        tables["tests"] = encounter_tables.contrast_table(rows, suite.rules.contrasts)
    if rows["value"].notna().any():
        tables["quarters"] = encounter_tables.quarter_table(rows)
        figures = chain(online.quarter_figures(tables["quarters"]), figures)
    _write_tables(tables, folder)
    pictures = write_figures(figures, folder / "figures", formats)
    write_text(folder / "index.html", online_page(tables, pictures, runs, suite))
    said = format_summary(_DRIVES, summary[_OF_DRIVES], rows[rows["status"] != "ok"], "drives")
    return f"{said}\n{folder}: index.html is the page, episodes.csv has a row for each drive"


def _rows(
    folder: Path, table_of: Callable[[Store, Suite], pd.DataFrame]
) -> tuple[list[Provenance], Suite, pd.DataFrame]:
    """The runs of a folder, the suite of the last one, and the rows of its store."""
    with read_store(folder) as store:
        runs = store.runs()
        suite = last_suite(runs, folder)
        return runs, suite, table_of(store, suite)


def _write_tables(
    tables: Mapping[str, pd.DataFrame], folder: Path, digits: str | None = None
) -> None:
    for name, table in tables.items():
        write_csv(table, folder / f"{name}.csv", digits)


def write_text(place: Path, text: str) -> None:
    """Write a text, completely or not at all."""
    with whole_file(place) as path:
        path.write_text(text, encoding="utf-8")


def write_figures(
    figures: Iterable[tuple[str, Figure]], folder: Path, formats: Sequence[str]
) -> list[str]:
    """Write figures by name, if there are formats; SVG elements for a page."""
    if not formats:
        return []
    pictures = []
    with style.applied():
        for name, figure in figures:
            pictures.append(style.svg_text(figure))
            style.save(figure, folder / style.file_name(name), formats)
    return pictures


def _refuse_unknown(store: Store, places: Sequence[tuple[float, int]]) -> None:
    known: set[tuple[float, int]] = set()
    for batch in store.batches() if places else ():
        known |= set(zip(*(batch.column(n).to_pylist() for n in ("sigma", "seed")), strict=True))
    for sigma, seed in places:
        if (sigma, seed) not in known:
            levels = ", ".join(f"{level:g}" for level in sorted({level for level, _ in known}))
            raise UserError(
                f"--play {sigma:g}:{seed}: the run has no such trial; it has the noise levels "
                f"{levels} and seeds up to {max(seed for _, seed in known)}"
            )

"""Write the report of a run: tables, page and figures, made from the store alone."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from olne_bench.bench.plan.draws import draws_of
from olne_bench.bench.plan.load import suite_names
from olne_bench.bench.plan.suite import read_suite_json
from olne_bench.bench.report.confirmations import confirmations_of
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.report.figures import draw_figures, draw_wins
from olne_bench.bench.report.leaderboard_text import latex, markdown
from olne_bench.bench.report.page.render import Extras, render_page
from olne_bench.bench.report.paragraphs import markdown_paragraphs
from olne_bench.bench.report.parts import Parts, write_trials
from olne_bench.bench.report.study import Study, study_of
from olne_bench.bench.report.tables import RunTables, tabulate
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.store import Store, read_store
from olne_bench.envs.solved.kept_draws import travelling
from olne_bench.errors import UserError
from olne_bench.files import whole_file


@dataclass(frozen=True)
class Report:
    """What was written.

    Attributes:
        tables: tables of the run.
        study: study of the run.
        notes: what could not be shown, and why.
    """

    tables: RunTables
    study: Study
    notes: list[str]


def write_report(
    folder: Path, formats: Sequence[str], playable: Sequence[tuple[float, int]] = ()
) -> Report:
    """Write tables, as CSV, the page ``index.html`` and ``figures/``.

    The tables are ``trials`` (also as Parquet), ``leaderboard``, ``errors_by_noise``,
    ``comparisons`` (of estimators, in pairs), ``wins`` (of draws), ``identifiability`` and
    ``bound_ratios`` (of weights), and, where drivers have temperaments, ``temperaments`` and
    ``confusions``; the leaderboard comes in Markdown, with a paragraph on each estimator, and
    LaTeX, too. Truths are read from the draws
    that come with the suite, where there are some. Only the trials of one scenario are in memory.

    Args:
        folder: a run folder.
        formats: formats of the figures; if empty, no figure is drawn.
        playable: noise levels and seeds of trials that the page must be able to play.

    Raises:
        UserError: if the folder holds no run, or cannot be written.
    """
    with read_store(folder) as store:
        runs = store.runs()
        if next(store.batches(), None) is None:
            raise UserError(f"the run in {folder} has no finished trial yet")
        _refuse_unknown(store, playable)
        suites = [read_suite_json(run.suite) for run in runs]
        study = replace(study_of(suites), confirmations=confirmations_of(folder, store))
        with _writing_to(folder):
            trials = write_trials(store.batches(), folder)
    shipped = suites and suites[-1].origin in suite_names()
    draws = draws_of(suites[-1].origin, suites[-1]) if shipped else None
    with _writing_to(folder), travelling(draws):
        return _written(folder, trials, runs, study, formats, playable)


def _written(
    folder: Path,
    trials: Parts,
    runs: list[Provenance],
    study: Study,
    formats: Sequence[str],
    playable: Sequence[tuple[float, int]],
) -> Report:
    tables = tabulate(trials, study)
    _write_tables(tables, study, folder)
    notes = list(tables.notes)
    if formats:
        draw_wins(tables.wins, folder / "figures", formats, study)
        notes += draw_figures(trials, folder / "figures", formats, study).notes
    page = render_page(trials, tables, runs, study, notes, Extras(playable=tuple(playable)))
    with whole_file(folder / "index.html") as path:
        path.write_text(page.html, encoding="utf-8")
    return Report(tables, study, list(dict.fromkeys([*notes, *page.notes])))


@contextmanager
def _writing_to(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise UserError(f"cannot write to {folder}: {error.strerror or error}") from error


def _refuse_unknown(store: Store, places: Sequence[tuple[float, int]]) -> None:
    if not places:
        return
    known: set[tuple[float, int]] = set()
    for batch in store.batches():
        known |= set(zip(*(batch.column(n).to_pylist() for n in ("sigma", "seed")), strict=True))
    for sigma, seed in places:
        if (sigma, seed) not in known:
            levels = ", ".join(f"{level:g}" for level in sorted({level for level, _ in known}))
            raise UserError(
                f"--play {sigma:g}:{seed}: the run has no such trial; it has the noise levels "
                f"{levels} and seeds up to {max(seed for _, seed in known)}"
            )


def _write_tables(tables: RunTables, study: Study, folder: Path) -> None:
    for name, table in tables.by_name().items():
        write_csv(table, folder / f"{name}.csv")
    said = markdown_paragraphs(tables.paragraphs)
    for name, text in (
        ("leaderboard.md", markdown(tables.leaderboard, study) + said),
        ("leaderboard.tex", latex(tables.leaderboard, study)),
    ):
        with whole_file(folder / name) as path:
            path.write_text(text, encoding="utf-8")

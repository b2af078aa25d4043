"""Write the report of a run of trials: tables, page and figures, made from the store."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from matplotlib.figure import Figure

from olne_bench.bench.plan.draws import draws_of
from olne_bench.bench.plan.load import suite_names
from olne_bench.bench.plan.suite import read_suite_json
from olne_bench.bench.report.confirmations import confirmations_of
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.report.figures import Drawn, draw_figures, style
from olne_bench.bench.report.leaderboard_text import latex, markdown
from olne_bench.bench.report.page.render import Extras, render_page
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

    The tables are ``trials`` (also as Parquet), ``leaderboard`` (also in Markdown and LaTeX),
    ``scores``, ``comparisons`` (of estimators, in pairs), ``errors_by_noise``,
    ``identifiability``, ``identifiability_by_noise``, ``bound_ratios`` (of weights),
    ``calibration`` and, where drivers have temperaments, ``temperaments`` and ``confusions``.
    Truths are read from the draws that come with the suite, where there are some. Only the trials
    of one scenario are in memory.

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
    for name, table in tables.by_name().items():
        write_csv(table, folder / f"{name}.csv")
    write_text(folder / "leaderboard.md", markdown(tables.leaderboard, study))
    write_text(folder / "leaderboard.tex", latex(tables.leaderboard, study))
    drawn = Drawn()
    if formats:
        drawn = draw_figures(trials, tables, folder / "figures", formats, study)
    notes = [*tables.notes, *drawn.notes]
    extras = Extras(playable=tuple(playable), pictures=drawn.pictures)
    page = render_page(trials, tables, runs, study, notes, extras)
    write_text(folder / "index.html", page.html)
    return Report(tables, study, list(dict.fromkeys([*notes, *page.notes])))


def write_text(place: Path, text: str) -> None:
    """Write a text, completely or not at all."""
    with whole_file(place) as path:
        path.write_text(text, encoding="utf-8")


def write_figures(
    figures: Iterable[tuple[str, Figure]], folder: Path, formats: Sequence[str]
) -> list[str]:
    """Write figures by name, if there are formats; SVG elements for a page."""
    pictures = []
    if formats:
        folder.mkdir(exist_ok=True)
        with style.applied():
            for name, figure in figures:
                pictures.append(style.svg_text(figure))
                style.save(figure, folder / style.file_name(name), formats)
    return pictures


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

"""Figures of a study, drawn from its table of trials.

There is one module per kind of figure, with a function ``draw(trials, study) -> Figure`` that takes
the trials of one scenario; that of ``wins`` takes a table of all. It raises ``NotDrawnError`` if it
cannot draw them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from olne_bench.bench.report.figures import (
    calibration,
    confusion,
    errors,
    failures,
    identifiability,
    landscape,
    ranks,
    style,
    trajectories,
    trial,
    widths,
    wins,
)
from olne_bench.bench.report.formats import FORMATS, USUAL_FORMATS
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.parts import Parts, of_each, parts_of
from olne_bench.bench.report.statistics.recognition import is_tempered
from olne_bench.bench.report.study import USUAL, Study

__all__ = ["FORMATS", "USUAL_FORMATS", "Drawn", "draw_figures", "draw_wins"]

_KINDS = {
    "errors": errors.draw,
    "failures": failures.draw,
    "trajectories": trajectories.draw,
    "landscape": landscape.draw,
    "calibration": calibration.draw,
    "ranks": ranks.draw,
    "widths": widths.draw,
    "identifiability": identifiability.draw,
}


@dataclass(frozen=True)
class Drawn:
    """The result of drawing figures.

    Attributes:
        files: paths of the files that were written.
        notes: what could not be drawn, and why.
    """

    files: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def draw_wins(
    table: pd.DataFrame,
    directory: Path,
    formats: Sequence[str] = USUAL_FORMATS,
    study: Study = USUAL,
) -> Drawn:
    """Draw ``wins.png`` and so on, of all scenarios together; nothing if nobody is compared.

    Args:
        table: from ``statistics.wins.win_table``.
        directory: folder for the files; created if absent.
        formats: some of ``FORMATS``.
        study: study of the run.
    """
    if table.empty:
        return Drawn()
    directory.mkdir(parents=True, exist_ok=True)
    with style.applied():
        return Drawn(style.save(wins.draw(table, study), directory / "wins", formats))


def draw_figures(
    trials: pd.DataFrame | Parts,
    directory: Path,
    formats: Sequence[str] = USUAL_FORMATS,
    study: Study = USUAL,
) -> Drawn:
    """Draw every figure that the trials allow, for each scenario separately.

    Args:
        trials: one row per trial, with the columns ``scenario, sensor, sigma, seed, estimator,
            status, observation_error, count, weights`` and one per metric. Any part of a study
            will do.
        directory: folder for ``<kind>_<scenario>.png`` and so on; created if absent.
        formats: some of ``FORMATS``.
        study: study of the run.

    Returns:
        The files written, and what is missing. The same trials give files with the same bytes.
    """
    directory.mkdir(parents=True, exist_ok=True)
    with style.applied():
        parts = of_each(
            parts_of(trials), lambda name, rows: _draw(name, rows, directory, formats, study)
        )
    files = [file for part in parts for file in part.files]
    return Drawn(files, [note for part in parts for note in part.notes])


def _draw(
    scenario: str, rows: pd.DataFrame, directory: Path, formats: Sequence[str], study: Study
) -> Drawn:
    """Draw the figures of one scenario."""
    drawn = Drawn()
    tempered = {"confusion": confusion.draw} if is_tempered(scenario, study) else {}
    road = {"trial": trial.draw} if trial.is_road(scenario, study) else {}
    for kind, draw in (_KINDS | tempered | road).items():
        try:
            figure = draw(rows, study)
        except NotDrawnError as error:
            drawn.notes.append(f"figure {kind} of {scenario}: {error}")
        else:
            stem = directory / f"{kind}_{style.file_name(scenario)}"
            drawn.files.extend(style.save(figure, stem, formats))
    return drawn

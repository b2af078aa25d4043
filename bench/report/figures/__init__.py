"""Figures of a study, made from its tables and trials.

There is one module per kind of figure, with a function ``draw`` that makes a ``Figure`` of one
scenario, or of the scores of all. It raises ``NotDrawnError`` if it cannot draw it. No figure has
more than six panels.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from olne_bench.bench.report.figures import (
    calibration,
    confusion,
    errors,
    failures,
    forest,
    identifiability,
    style,
    trial,
    widths,
)
from olne_bench.bench.report.formats import FORMATS, USUAL_FORMATS
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.parts import Parts, of_each, parts_of
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.bench.report.tables import RunTables

__all__ = ["FORMATS", "USUAL_FORMATS", "Drawn", "draw_figures"]


@dataclass(frozen=True)
class Drawn:
    """The result of drawing figures.

    Attributes:
        files: paths of the files that were written.
        notes: what could not be drawn, and why.
        pictures: SVG elements for a page by scenario, and by kind; that of all has the scenario "".
    """

    files: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    pictures: dict[str, dict[str, str]] = field(default_factory=dict)


def draw_figures(
    trials: pd.DataFrame | Parts,
    tables: RunTables,
    directory: Path,
    formats: Sequence[str] = USUAL_FORMATS,
    study: Study = USUAL,
) -> Drawn:
    """Draw every figure that the trials allow: ``scores``, and others for each scenario.

    Args:
        trials: one row per trial, as in ``trials.parquet``. Any part of a study will do.
        tables: tables of these trials.
        directory: folder for ``<kind>_<scenario>.png`` and so on; created if absent.
        formats: some of ``FORMATS``.
        study: study of the run.

    Returns:
        The files written, and what is missing. The same trials give files with the same bytes.
    """
    directory.mkdir(parents=True, exist_ok=True)
    drawn = Drawn()

    def add(kind: str, scenario: str, draw: Callable[[], Figure]) -> None:
        try:
            figure = draw()
        except NotDrawnError as error:
            of = f" of {scenario}" if scenario else ""
            drawn.notes.append(f"figure {kind}{of}: {error}")
            return
        name = f"{kind}_{style.file_name(scenario)}" if scenario else kind
        drawn.pictures.setdefault(scenario, {})[kind] = style.svg_text(figure)
        drawn.files.extend(style.save(figure, directory / name, formats))

    def scenario(name: str, rows: pd.DataFrame) -> None:
        for kind, draw in _kinds(name, rows, tables, study).items():
            add(kind, name, draw)

    with style.applied():
        add("scores", "", lambda: forest.draw(tables.scores, study))
        of_each(parts_of(trials), scenario)
    return drawn


def _kinds(
    name: str, rows: pd.DataFrame, tables: RunTables, study: Study
) -> dict[str, Callable[[], Figure]]:
    """How the figures of a scenario are drawn, by kind."""

    def own(table: pd.DataFrame) -> pd.DataFrame:
        return table[table["scenario"] == name]

    usual: dict[str, Callable[[], Figure]] = {
        "trial": lambda: trial.draw(rows, study),
        "errors": lambda: errors.draw(rows, study),
        "failures": lambda: failures.draw(rows, study),
        "identifiability": lambda: identifiability.draw(own(tables.identifiability_by_noise)),
        "calibration": lambda: calibration.draw(rows, study),
        "widths": lambda: widths.draw(rows, study),
    }
    drivers = own(tables.confusions)
    return usual | ({"confusion": lambda: confusion.draw(drivers)} if len(drivers) else {})

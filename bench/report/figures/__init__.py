"""Figures of a study: ``draw`` makes one of a scenario or of all scores, or ``NotDrawnError``."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from olne_bench.bench.report.figures import (
    calibration,
    confusion,
    damage,
    forest,
    over_noise,
    style,
    trial,
)
from olne_bench.bench.report.formats import USUAL_FORMATS, NotDrawnError
from olne_bench.bench.report.parts import Parts, of_each, parts_of
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.bench.report.tables import RunTables

#: SVG elements for a page by scenario, and by kind; that of all has the scenario "".
Pictures = dict[str, dict[str, str]]


def draw_figures(
    trials: pd.DataFrame | Parts,
    tables: RunTables,
    directory: Path,
    formats: Sequence[str] = USUAL_FORMATS,
    study: Study = USUAL,
) -> tuple[Pictures, list[str]]:
    """Draw ``scores``, ``damage``, and others of each scenario, if there are formats.

    Those of ``study.figures`` alone, if it names any. Files are named ``<kind>_<scenario>.png`` and
    so on. The same trials give the same bytes. What could not be drawn is told, and why.
    """
    pictures: Pictures = {}
    notes: list[str] = []
    if not formats:
        return pictures, notes

    def add(kind: str, scenario: str, draw: Callable[[], Figure]) -> None:
        if study.figures and kind not in study.figures:
            return
        try:
            figure = draw()
        except NotDrawnError as error:
            of = f" of {scenario}" if scenario else ""
            notes.append(f"figure {kind}{of}: {error}")
            return
        name = f"{kind}_{style.file_name(scenario)}" if scenario else kind
        pictures.setdefault(scenario, {})[kind] = style.svg_text(figure)
        style.save(figure, directory / name, formats)

    def scenario(name: str, rows: pd.DataFrame) -> None:
        known, drivers = (
            table[table["scenario"] == name]
            for table in (tables.identifiability_by_noise, tables.confusions)
        )
        add("trial", name, lambda: trial.draw(rows, study))
        add("errors", name, lambda: over_noise.draw_errors(rows, study))
        add("failures", name, lambda: over_noise.draw_failures(rows))
        add("identifiability", name, lambda: over_noise.draw_identifiability(known))
        add("calibration", name, lambda: calibration.draw_coverage(rows))
        add("widths", name, lambda: calibration.draw_widths(rows))
        if len(drivers):
            add("confusion", name, lambda: confusion.draw(drivers))

    with style.applied():
        add("scores", "", lambda: forest.draw(tables.scores, study))
        if len(tables.damage):
            add("damage", "", lambda: damage.draw(tables.damage))
        of_each(parts_of(trials), scenario)
    return pictures, notes

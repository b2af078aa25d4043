"""Figures of a study, made from its tables and trials.

Functions named ``draw`` make a ``Figure`` of one scenario, or of the scores of all. They raise
``NotDrawnError`` if they cannot. No figure has more than six panels.
"""

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
    """Draw every figure that the trials allow: ``scores``, ``damage``, and others of a scenario.

    Files are named ``<kind>_<scenario>.png`` and so on, in as many formats as there are, if any.
    The same trials give the same bytes. What could not be drawn is told, and why.
    """
    pictures: Pictures = {}
    notes: list[str] = []
    if not formats:
        return pictures, notes

    def add(kind: str, scenario: str, draw: Callable[[], Figure]) -> None:
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
        for kind, draw in _kinds(name, rows, tables, study).items():
            add(kind, name, draw)

    with style.applied():
        add("scores", "", lambda: forest.draw(tables.scores, study))
        if len(tables.damage):
            add("damage", "", lambda: damage.draw(tables.damage))
        of_each(parts_of(trials), scenario)
    return pictures, notes


def _kinds(
    name: str, rows: pd.DataFrame, tables: RunTables, study: Study
) -> dict[str, Callable[[], Figure]]:
    """How the figures of a scenario are drawn, by kind."""
    known, drivers = (
        table[table["scenario"] == name]
        for table in (tables.identifiability_by_noise, tables.confusions)
    )
    kinds: dict[str, Callable[[], Figure]] = {
        "trial": lambda: trial.draw(rows, study),
        "errors": lambda: over_noise.draw_errors(rows, study),
        "failures": lambda: over_noise.draw_failures(rows),
        "identifiability": lambda: over_noise.draw_identifiability(known),
        "calibration": lambda: calibration.draw_coverage(rows),
        "widths": lambda: calibration.draw_widths(rows),
    }
    return kinds | ({"confusion": lambda: confusion.draw(drivers)} if len(drivers) else {})

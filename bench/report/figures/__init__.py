"""Figures of a study: ``draw`` makes one of a scenario or of all scores, or ``NotDrawnError``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import get_args

import pandas as pd
from matplotlib.figure import Figure

from olne_bench.bench.plan.kinds import FigureKind
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
#: Pictures, and notes of what could not be drawn, and why.
Drawn = tuple[Pictures, list[str]]


@dataclass(frozen=True)
class Studio:
    """Draws figures into a folder: those of ``study.figures`` alone, if it names any."""

    folder: Path
    formats: Sequence[str]
    study: Study
    pictures: Pictures = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def add(self, kind: str, scenario: str, draw: Callable[[], Figure]) -> None:
        """Draw a figure of a scenario, or of all (""), and write it."""
        if self.study.figures and kind not in self.study.figures:
            return
        try:
            figure = draw()
        except NotDrawnError as error:
            of = f" of {scenario}" if scenario else ""
            self.notes.append(f"figure {kind}{of}: {error}")
            return
        name = f"{kind}_{style.file_name(scenario)}" if scenario else kind
        self.pictures.setdefault(scenario, {})[kind] = style.svg_text(figure)
        style.save(figure, self.folder / name, self.formats)


def draw_figures(
    trials: pd.DataFrame | Parts,
    tables: RunTables,
    folder: Path,
    formats: Sequence[str] = USUAL_FORMATS,
    study: Study = USUAL,
    of_rows: Callable[[], Drawn] | None = None,
) -> Drawn:
    """Draw ``scores``, ``damage``, and others of each scenario, if there are formats.

    Files are named ``<kind>_<scenario>.png`` and so on. The same trials give the same bytes. What
    ``draw_rows`` draws may come from elsewhere.
    """
    parts = parts_of(trials)
    of_tables = _draw_tables(parts, tables, folder, formats, study)
    rows = draw_rows(parts, folder, formats, study) if of_rows is None else of_rows()
    return _merged(rows, of_tables)


def draw_rows(parts: Parts, folder: Path, formats: Sequence[str], study: Study) -> Drawn:
    """Draw the figures of each scenario that need its rows alone."""
    studio = Studio(folder, formats, study)

    def scenario(name: str, rows: pd.DataFrame) -> None:
        studio.add("trial", name, lambda: trial.draw(rows, study))
        studio.add("errors", name, lambda: over_noise.draw_errors(rows, study))
        studio.add("failures", name, lambda: over_noise.draw_failures(rows))
        studio.add("calibration", name, lambda: calibration.draw_coverage(rows))
        studio.add("widths", name, lambda: calibration.draw_widths(rows))

    if formats:
        with style.applied():
            of_each(parts, scenario)
    return studio.pictures, studio.notes


def _draw_tables(
    parts: Parts, tables: RunTables, folder: Path, formats: Sequence[str], study: Study
) -> Drawn:
    """Draw the figures of what tables say."""
    studio = Studio(folder, formats, study)
    if not formats:
        return studio.pictures, studio.notes
    with style.applied():
        studio.add("scores", "", lambda: forest.draw(tables.scores, study))
        if len(tables.damage):
            studio.add("damage", "", lambda: damage.draw(tables.damage))
        for name in parts.outline.scenarios:
            known, drivers = (
                table[table["scenario"] == name]
                for table in (tables.identifiability_by_noise, tables.confusions)
            )
            studio.add("identifiability", name, partial(over_noise.draw_identifiability, known))
            if len(drivers):
                studio.add("confusion", name, partial(confusion.draw, drivers))
    return studio.pictures, studio.notes


def _merged(one: Drawn, other: Drawn) -> Drawn:
    """What was drawn of rows and of tables, by scenario and in the order of kinds."""
    names = dict.fromkeys([*other[0], *one[0]])
    both = {name: one[0].get(name, {}) | other[0].get(name, {}) for name in names}
    pictures = {
        n: {kind: own[kind] for kind in get_args(FigureKind) if kind in own}
        for n, own in both.items()
    }
    return pictures, [*other[1], *one[1]]

"""The trials of a run, one scenario at a time, so that a report never holds all of them."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv, dataset, parquet

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.bench.report.escapes import csv_safe_arrow
from olne_bench.bench.report.statistics.attempts import weighed
from olne_bench.bench.report.study import worth_a_table
from olne_bench.bench.run.store_table import parquet_options, parse_nested, to_frame
from olne_bench.files import whole_file

#: Columns of a stored table that no report needs.
_UNUSED = {"suite", "salt_id", "parameters", "extras", "objective", "truth_objective"}
_UNUSED |= {*VERSION_COLUMNS}
_CELL = ["scenario", "sensor", "estimator"]
T = TypeVar("T")


@dataclass(frozen=True)
class Outline:
    """What the trials of a run are about."""

    suite: str
    cells: pd.DataFrame  # scenario, sensor, estimator that occur, sorted
    columns: frozenset[str]
    valued: frozenset[str]  # columns that have a value somewhere
    some_ok: bool  # whether any trial went well

    @property
    def scenarios(self) -> list[str]:
        """Labels of the scenarios, sorted."""
        return sorted(self.cells["scenario"].unique())

    def metrics(self, metrics: Iterable[MetricDeclaration]) -> list[MetricDeclaration]:
        """The metrics that tables of the whole run have, as ``in_table`` says."""
        known = [metric for metric in metrics if metric.name in self.columns]
        return [m for m in known if worth_a_table(m, m.name in self.valued, self.some_ok)]


@dataclass(frozen=True)
class Parts:
    """The trials of a run by scenario: ``of`` gives those of a label."""

    outline: Outline
    of: Callable[[str], pd.DataFrame]


def parts_of(trials: pd.DataFrame | Parts) -> Parts:
    """The trials by scenario, wherever they are."""
    if isinstance(trials, Parts):
        return trials
    suite = str(trials["suite"].iloc[0]) if len(trials) and "suite" in trials else ""
    valued = frozenset(str(name) for name in trials if trials[name].notna().any())
    columns, some_ok = frozenset(map(str, trials)), bool(trials["status"].eq("ok").any())
    outline = Outline(suite, _sorted(trials[_CELL]), columns, valued, some_ok)
    return Parts(outline, lambda scenario: trials[trials["scenario"] == scenario])


def of_each(parts: Parts, make: Callable[[str, pd.DataFrame], T]) -> list[T]:
    """What a function makes of each scenario's label and trials, which are freed after each."""
    return [make(name, parts.of(name)) for name in parts.outline.scenarios]


def write_trials(batches: Iterable[pa.RecordBatch], folder: Path) -> Parts:
    """Write ``trials.csv`` and ``trials.parquet``, batch by batch, of which there is one at least.

    Only the trials of one scenario are read again at a time.
    """
    outlines: list[Outline] = []
    path = folder / "trials.parquet"
    files = whole_file(folder / "trials.csv"), whole_file(path)
    with files[0] as text, files[1] as binary, ExitStack() as writers:
        for batch in batches:
            rows = pa.Table.from_batches([batch])
            parsed = parse_nested(rows)
            if not outlines:
                written = writers.enter_context(csv.CSVWriter(text, rows.schema))
                options = parquet_options(parsed.schema)
                stored = parquet.ParquetWriter(binary, parsed.schema, **options)
                writers.enter_context(stored)
            outlines.append(_outline(rows))
            written.write_table(csv_safe_arrow(rows))
            stored.write_table(parsed)
    return Parts(_united(outlines), partial(_read, path))


def _read(path: Path, scenario: str) -> pd.DataFrame:
    """The trials of one scenario in a Parquet file, weighed, with the columns that reports need."""
    source = dataset.dataset(path)
    columns = [name for name in source.schema.names if name not in _UNUSED]
    chosen = dataset.field("scenario") == scenario
    trials = to_frame(source.to_table(columns=columns, filter=chosen))
    pa.default_memory_pool().release_unused()
    return weighed(trials)


def _outline(rows: pa.Table) -> Outline:
    cells = rows.select(_CELL).group_by(_CELL).aggregate([]).to_pandas()
    valued = frozenset(n for n in rows.column_names if rows.column(n).null_count < len(rows))
    some_ok = bool(pc.any(pc.equal(rows.column("status"), "ok")).as_py())
    suite = str(rows.column("suite")[0])
    return Outline(suite, cells, frozenset(rows.column_names), valued, some_ok)


def _united(outlines: Sequence[Outline]) -> Outline:
    """The outline of all batches, which have the same columns."""
    cells = _sorted(pd.concat([one.cells for one in outlines]))
    valued = frozenset[str]().union(*(one.valued for one in outlines))
    some_ok = any(one.some_ok for one in outlines)
    return Outline(outlines[0].suite, cells, outlines[0].columns, valued, some_ok)


def _sorted(cells: pd.DataFrame) -> pd.DataFrame:
    return cells.drop_duplicates().sort_values(_CELL, ignore_index=True)


def joined(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Tables of the parts as one; empty ones count only if all are."""
    filled = [table for table in tables if len(table)]
    return pd.concat(filled, ignore_index=True) if filled else tables[0]

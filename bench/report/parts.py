"""The trials of a run, one scenario at a time, so that a report never holds all of them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv, dataset, parquet

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.bench.report.escapes import csv_safe_arrow
from olne_bench.bench.report.measures import worth_a_table
from olne_bench.bench.report.statistics.attempts import weighed
from olne_bench.bench.run.store_table import parquet_options, parse_nested, to_frame
from olne_bench.files import whole_file

#: Columns of a stored table that no report needs.
_UNUSED = {
    "suite",
    "salt_id",
    "parameters",
    "extras",
    "objective",
    "truth_objective",
    *VERSION_COLUMNS,
}
_CELL = ["scenario", "sensor", "estimator"]
T = TypeVar("T")


@dataclass(frozen=True)
class Outline:
    """What the trials of a run are about.

    Attributes:
        suite: name of the suite.
        cells: ``scenario, sensor, estimator`` that occur, sorted.
        columns: names of all columns.
        valued: columns that have a value somewhere.
        some_ok: whether any trial went well.
    """

    suite: str
    cells: pd.DataFrame
    columns: frozenset[str]
    valued: frozenset[str]
    some_ok: bool

    @property
    def scenarios(self) -> list[str]:
        """Labels of the scenarios, sorted."""
        return sorted(self.cells["scenario"].unique())

    def metrics(self, metrics: Iterable[MetricDeclaration]) -> list[MetricDeclaration]:
        """The metrics that tables of the whole run have, as ``measures.in_table`` says."""
        known = [metric for metric in metrics if metric.name in self.columns]
        return [m for m in known if worth_a_table(m, m.name in self.valued, self.some_ok)]


class Parts(Protocol):
    """The trials of a run by scenario."""

    outline: Outline

    def of(self, scenario: str) -> pd.DataFrame:
        """The trials of one scenario, with the columns that reports need."""
        ...


class FrameParts:
    """Trials that are in memory."""

    def __init__(self, trials: pd.DataFrame) -> None:
        cells = trials[_CELL].drop_duplicates().sort_values(_CELL, ignore_index=True)
        suite = str(trials["suite"].iloc[0]) if len(trials) and "suite" in trials else ""
        valued = frozenset(str(name) for name in trials if trials[name].notna().any())
        columns, some_ok = frozenset(map(str, trials)), bool(trials["status"].eq("ok").any())
        self.outline = Outline(suite, cells, columns, valued, some_ok)
        self._trials = trials

    def of(self, scenario: str) -> pd.DataFrame:
        """The trials of one scenario."""
        return self._trials[self._trials["scenario"] == scenario]


class FileParts:
    """Trials in a Parquet file, of which only those of one scenario are read at a time."""

    def __init__(self, path: Path, outline: Outline) -> None:
        self.outline = outline
        self._path = path

    def of(self, scenario: str) -> pd.DataFrame:
        """The trials of one scenario, weighed as ``weighed`` does."""
        source = dataset.dataset(self._path)
        columns = [name for name in source.schema.names if name not in _UNUSED]
        chosen = dataset.field("scenario") == scenario
        trials = to_frame(source.to_table(columns=columns, filter=chosen))
        pa.default_memory_pool().release_unused()
        return weighed(trials)


def parts_of(trials: "pd.DataFrame | Parts") -> Parts:
    """The trials by scenario, wherever they are."""
    return FrameParts(trials) if isinstance(trials, pd.DataFrame) else trials


def of_each(parts: Parts, make: Callable[[str, pd.DataFrame], T]) -> list[T]:
    """What a function makes of each scenario's label and trials, which are freed after each."""
    return [make(name, parts.of(name)) for name in parts.outline.scenarios]


def write_trials(batches: Iterable[pa.RecordBatch], folder: Path) -> FileParts:
    """Write ``trials.csv`` and ``trials.parquet``, batch by batch.

    Args:
        batches: at least one, from ``Store.batches``.
        folder: folder of the files.

    Raises:
        UserError: on nested lists that cannot be read.
        OSError: if a file cannot be written.
    """
    notes = _Notes()
    path = folder / "trials.parquet"
    with whole_file(folder / "trials.csv") as text, whole_file(path) as binary:
        written: csv.CSVWriter | None = None
        stored: parquet.ParquetWriter | None = None
        try:
            for batch in batches:
                rows = pa.Table.from_batches([batch])
                parsed = parse_nested(rows)
                notes.add(rows)
                written = written or csv.CSVWriter(text, rows.schema)
                stored = stored or parquet.ParquetWriter(
                    binary, parsed.schema, **parquet_options(parsed.schema)
                )
                written.write_table(csv_safe_arrow(rows))
                stored.write_table(parsed)
        finally:
            for writer in (written, stored):
                if writer is not None:
                    writer.close()
    return FileParts(path, notes.outline())


class _Notes:
    """What is noted of each batch for the outline."""

    def __init__(self) -> None:
        self._suite = ""
        self._cells: list[pa.Table] = []
        self._columns: frozenset[str] = frozenset()
        self._valued: set[str] = set()
        self._some_ok = False

    def add(self, rows: pa.Table) -> None:
        self._suite = self._suite or str(rows.column("suite")[0])
        self._columns = frozenset(rows.column_names)
        self._cells.append(_distinct(rows.select(_CELL)))
        self._valued |= {n for n in rows.column_names if rows.column(n).null_count < len(rows)}
        self._some_ok |= bool(pc.any(pc.equal(rows.column("status"), "ok")).as_py())

    def outline(self) -> Outline:
        cells = _distinct(pa.concat_tables(self._cells)).to_pandas()
        cells = cells.sort_values(_CELL, ignore_index=True)
        return Outline(self._suite, cells, self._columns, frozenset(self._valued), self._some_ok)


def _distinct(cells: pa.Table) -> pa.Table:
    return cells.group_by(_CELL).aggregate([])


def joined(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Tables of the parts as one; empty ones count only if all are."""
    filled = [table for table in tables if len(table)]
    return pd.concat(filled, ignore_index=True) if filled else tables[0]

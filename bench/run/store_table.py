"""Rows of a store as Arrow and pandas tables."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd
import pyarrow as pa

from olne_bench.bench.plan.outcome import NESTED
from olne_bench.errors import UserError

NUMBERS = pa.list_(pa.list_(pa.float64()))

#: What ``as_batch`` raises on a value of another type.
BAD_VALUES = (TypeError, OverflowError, pa.ArrowException)

_TYPES = {"TEXT": pa.string(), "REAL": pa.float64(), "INTEGER": pa.int64()}


def schema_of(columns: Mapping[str, str]) -> pa.Schema:
    """The Arrow schema of columns with these names and SQL types."""
    return pa.schema([(name, _TYPES[kind]) for name, kind in columns.items()])


def as_batch(rows: Iterable[Sequence[Any]], columns: Mapping[str, str]) -> pa.RecordBatch:
    """Rows as a part of a table.

    Args:
        rows: at least one.
        columns: names and SQL types of the columns, in the order of the rows' first values.

    Raises:
        BAD_VALUES: on a value of another type.
    """
    schema = schema_of(columns)
    parts = zip(*rows, strict=True)
    return pa.record_batch(
        [pa.array(c, type=t) for c, t in zip(parts, schema.types, strict=False)], schema=schema
    )


def parquet_options(schema: pa.Schema) -> dict[str, Any]:
    """How Parquet tables are written: the bytes of numbers apart, which saves a quarter."""
    return {
        "compression": "zstd",
        "use_dictionary": [column.name for column in schema if not _numbers_in(column)],
        "use_byte_stream_split": [path for column in schema for path in _numbers_in(column)],
    }


def _numbers_in(column: pa.Field) -> list[str]:
    """Parquet's path of the floating point numbers in a column, if it has any."""
    kind, path = column.type, column.name
    while pa.types.is_list(kind):
        kind, path = kind.value_type, f"{path}.list.element"
    return [path] if pa.types.is_floating(kind) else []


def parse_nested(table: pa.Table) -> pa.Table:
    """``Store.table()`` with weights and unknowns as nested lists.

    Raises:
        UserError: on texts that cannot be read.
    """
    for name in NESTED:
        place = table.schema.get_field_index(name)
        try:
            chunks = [_parsed(chunk) for chunk in table.column(place).chunks]
        except (ValueError, RecursionError, pa.ArrowException) as error:
            raise UserError(
                f"the store is damaged: {name} that cannot be read ({error})"
            ) from error
        table = table.set_column(place, name, pa.chunked_array(chunks, type=NUMBERS))
    return table


def _parsed(texts: pa.Array) -> pa.Array:
    # One call of the parser per chunk is much faster than one per row.
    return pa.array(json.loads(f"[{','.join(t or 'null' for t in texts.to_pylist())}]"), NUMBERS)


def to_frame(table: pa.Table) -> pd.DataFrame:
    """A table as a pandas table, in which nested lists stay in Arrow's compact form."""
    types = {NUMBERS: pd.ArrowDtype(NUMBERS)}
    frame: pd.DataFrame = table.to_pandas(types_mapper=types.get, split_blocks=True)
    return frame

"""Rows of a store as Arrow and pandas tables."""

import json
import sqlite3
from collections.abc import Mapping

import pandas as pd
import pyarrow as pa

from olne_bench.errors import UserError

WEIGHTS = pa.list_(pa.list_(pa.float64()))

_TYPES = {"TEXT": pa.string(), "REAL": pa.float64(), "INTEGER": pa.int64()}
_BATCH = 50_000


def as_table(rows: sqlite3.Cursor, columns: Mapping[str, str]) -> pa.Table:
    """The rows of a query as an Arrow table.

    Args:
        rows: cursor of the query.
        columns: names and SQL types of the columns, in the order of the query.
    """
    schema = pa.schema([(name, _TYPES[kind]) for name, kind in columns.items()])
    batches = []
    while batch := rows.fetchmany(_BATCH):
        parts = zip(*batch, strict=True)
        arrays = [pa.array(c, type=t) for c, t in zip(parts, schema.types, strict=True)]
        batches.append(pa.record_batch(arrays, schema=schema))
    return pa.Table.from_batches(batches, schema=schema)


def parse_weights(table: pa.Table) -> pa.Table:
    """``Store.table()`` with weights as nested lists.

    Raises:
        UserError: on weights that cannot be read.
    """
    place = table.schema.get_field_index("weights")
    try:
        chunks = [
            # One call of the parser per chunk is much faster than one per row.
            pa.array(
                json.loads(f"[{','.join(t or 'null' for t in chunk.to_pylist())}]"), type=WEIGHTS
            )
            for chunk in table.column(place).chunks
        ]
    except (ValueError, RecursionError, pa.ArrowException) as error:
        raise UserError(f"the store is damaged: weights that cannot be read ({error})") from error
    return table.set_column(place, "weights", pa.chunked_array(chunks, type=WEIGHTS))


def to_frame(table: pa.Table) -> pd.DataFrame:
    """A table as a pandas table, in which nested lists stay in Arrow's compact form."""
    types = {WEIGHTS: pd.ArrowDtype(WEIGHTS)}
    return table.to_pandas(types_mapper=types.get)

"""Rows of a store as Arrow and pandas tables."""

import json

import pandas as pd
import pyarrow as pa

from olne_bench.errors import UserError

WEIGHTS = pa.list_(pa.list_(pa.float64()))


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

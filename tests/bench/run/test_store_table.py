"""Rows as tables: what is written to Parquet files."""

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from olne_bench.bench.run.store_table import NUMBERS, parquet_options


def test_numbers_are_kept_apart_and_come_back_bit_by_bit(tmp_path) -> None:
    rng = np.random.default_rng(0)
    table = pa.table(
        {
            "status": pa.array(["ok", None] * 500),
            "seed": pa.array(range(1000)),
            "error": pa.array(rng.random(1000)),
            "weights": pa.array([None, *rng.dirichlet(np.ones(4), (999, 2)).tolist()], NUMBERS),
        }
    )
    path, plain = tmp_path / "apart.parquet", tmp_path / "plain.parquet"
    parquet.write_table(table, path, **parquet_options(table.schema))
    parquet.write_table(table, plain, compression="zstd")
    assert parquet.read_table(path).equals(table)
    assert path.stat().st_size < 0.95 * plain.stat().st_size
    apart = {
        part.path_in_schema
        for part in (parquet.read_metadata(path).row_group(0).column(k) for k in range(4))
        if "BYTE_STREAM_SPLIT" in part.encodings
    }
    assert apart == {"error", "weights.list.element.list.element"}

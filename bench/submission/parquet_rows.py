"""Read the rows of a submission from Parquet, which may be a trap.

A few kilobytes may stand for billions of rows, or for texts and lists that fill any memory, and
what the file says of its size need not be true. So it is read in a process of its own, which ends
where it needs more memory or time than rows do. What comes back has been counted.
"""

import gc
import io
import resource
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from olne_bench.bench.plan.outcome import NESTED, OUTCOME_COLUMNS
from olne_bench.bench.plan.trial import LABEL_COLUMNS
from olne_bench.bench.plan.values import cut, shown
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.bench.process.child import Child, ChildError, RaisedError
from olne_bench.bench.run.store_table import NUMBERS, schema_of
from olne_bench.errors import UserError

#: Largest number of rows of a submission.
MOST_ROWS = 50_000
#: Largest size of all rows in memory [bytes].
MOST_ROW_BYTES = 40_000_000
#: Memory that reading them may take [bytes].
_MEMORY = 180_000_000
#: Time that it may take [s].
_SECONDS = 60.0
_MOST_COLUMNS = 200
_MOST_GROUPS = 1000
_BATCH = 1000
#: Largest size of texts and lists in the file's own description of its contents [bytes, items].
_THRIFT = 5_000_000


def read_parquet(data: bytes, place: Path) -> pa.Table:
    """The rows in a file, each column of the type that rows have; UserError names the place."""
    child = Child()
    try:
        packed: bytes = child.call(_read, data, kind=bytes, seconds=_SECONDS)
    except UserError as error:
        raise UserError(f"{place} {error}") from error
    except (ChildError, RaisedError) as error:
        raise UserError(f"{place} cannot be read: {cut(str(error))}") from error
    finally:
        child.stop()
    return pa.ipc.open_stream(packed).read_all()


def _read(data: bytes) -> bytes:
    """In the process of its own: the checked rows as an Arrow stream."""
    pa.set_cpu_count(1)
    _limit_memory()
    try:
        file = parquet.ParquetFile(
            io.BytesIO(data),
            pre_buffer=False,
            thrift_string_size_limit=_THRIFT,
            thrift_container_size_limit=_THRIFT // 10,
        )
        _check_size(file.metadata)
        schema = _schema(file.schema_arrow)
        table = _limited(file, schema)
    except MemoryError as error:
        raise UserError("needs more memory than rows of a submission do") from error
    except (OSError, pa.ArrowException, ValueError) as error:
        raise UserError(f"cannot be read: {cut(str(error))}") from error
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return bytes(sink.getvalue())


def _limit_memory() -> None:
    gc.collect()
    with Path("/proc/self/status").open() as file:
        held = next(int(line.split()[1]) * 1024 for line in file if line.startswith("VmData:"))
    resource.setrlimit(resource.RLIMIT_DATA, (held + _MEMORY, held + _MEMORY))


def _check_size(about: parquet.FileMetaData) -> None:
    for what, number, most in (
        ("rows", about.num_rows, MOST_ROWS),
        ("columns", about.num_columns, _MOST_COLUMNS),
        ("row groups", about.num_row_groups, _MOST_GROUPS),
    ):
        if not 0 <= number <= most:
            raise UserError(f"has {number} {what}; at most {most} are allowed")


def _schema(found: pa.Schema) -> pa.Schema:
    """The schema of rows: the columns of every trial, and metrics."""
    usual = schema_of(LABEL_COLUMNS | OUTCOME_COLUMNS | VERSION_COLUMNS)
    wanted = {field.name: field.type for field in usual} | dict.fromkeys(NESTED, NUMBERS)
    lacking = [name for name in wanted if name not in found.names]
    if lacking:
        raise UserError(f"has no column {lacking[0]!r}")
    if len(set(found.names)) < len(found.names):
        raise UserError("has two columns of one name")
    metrics = {name: pa.float64() for name in found.names if name not in wanted}
    for name, kind in (wanted | metrics).items():
        there = found.field(name).type
        if there != kind:
            raise UserError(f"has {shown(name)} of type {cut(str(there))}, not {kind}")
    return pa.schema([*(wanted | metrics).items()])


def _limited(file: parquet.ParquetFile, schema: pa.Schema) -> pa.Table:
    """The rows, some at a time, as long as they are not too many."""
    batches: list[pa.RecordBatch] = []
    rows = size = 0
    for batch in file.iter_batches(batch_size=_BATCH, columns=schema.names, use_threads=False):
        rows += batch.num_rows
        size += batch.nbytes
        if rows > MOST_ROWS or size > MOST_ROW_BYTES:
            raise UserError(
                f"has more than {MOST_ROWS} rows, or they take more than {MOST_ROW_BYTES} bytes"
            )
        batches.append(batch.select(schema.names))
    table = pa.Table.from_batches(batches, schema=batches[0].schema if batches else schema)
    return table.cast(schema)

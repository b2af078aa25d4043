"""Rows in Parquet: small files that fill memories are refused in seconds."""

import io
import os
import resource
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from olne_bench.bench.plan.outcome import NESTED, OUTCOME_COLUMNS
from olne_bench.bench.plan.trial import LABEL_COLUMNS
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.bench.run.store_table import NUMBERS, schema_of
from olne_bench.bench.submission import parquet_rows
from olne_bench.bench.submission.parquet_rows import MOST_ROWS, read_parquet
from olne_bench.errors import UserError

PLACE = Path("rows.parquet")


def usual(rows: int = 3) -> pa.Table:
    schema = schema_of(LABEL_COLUMNS | OUTCOME_COLUMNS | VERSION_COLUMNS)
    columns = {
        field.name: pa.nulls(rows, NUMBERS if field.name in NESTED else field.type)
        for field in schema
    }
    return pa.table(columns | {"position_error": pa.nulls(rows, pa.float64())})


def with_column(name: str, values: pa.Array) -> pa.Table:
    table = usual(len(values))
    return table.set_column(table.schema.get_field_index(name), name, values)


def written(table: pa.Table, **options: object) -> bytes:
    sink = io.BytesIO()
    parquet.write_table(table, sink, compression="zstd", **options)
    return sink.getvalue()


def refused(data: bytes) -> str:
    with pytest.raises(UserError) as caught:
        read_parquet(data, PLACE)
    text = str(caught.value)
    assert text.startswith("rows.parquet ")
    assert "\n" not in text
    assert len(text) < 500
    return text


class Here:
    """Reads in this process, which starts sooner."""

    def call(self, function: Callable[[bytes], bytes], data: bytes, **_options: object) -> bytes:
        return function(data)

    def stop(self) -> None:
        pass


@pytest.fixture
def here(monkeypatch) -> None:
    monkeypatch.setattr(parquet_rows, "Child", Here)
    monkeypatch.setattr(parquet_rows, "_limit_memory", lambda: None)


def test_rows_come_back_as_they_were() -> None:
    table = with_column("weights", pa.array([[[0.5, 0.5]], None], NUMBERS))
    assert read_parquet(written(table), PLACE).to_pylist() == table.to_pylist()
    assert read_parquet(written(usual(0)), PLACE).num_rows == 0


def bomb_of_text() -> pa.Table:
    return with_column("message", pa.array(["x" * 3_000_000] * 300))


def bomb_of_numbers() -> pa.Table:
    return with_column("weights", pa.array([[[0.0] * 30_000_000]], NUMBERS))


@pytest.mark.parametrize("make", [bomb_of_text, bomb_of_numbers])
def test_what_unpacks_to_gigabytes_ends_in_a_process_of_its_own(make) -> None:
    data = written(make())
    assert len(data) < 100_000
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    said = refused(data)
    assert "more memory than rows" in said or "take more than" in said
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # [kB]


@pytest.mark.usefixtures("here")
def test_rows_have_a_number() -> None:
    assert read_parquet(written(usual(MOST_ROWS)), PLACE).num_rows == MOST_ROWS
    said = refused(written(usual(MOST_ROWS + 1)))
    assert said == f"rows.parquet has {MOST_ROWS + 1} rows; at most {MOST_ROWS} are allowed"


@pytest.mark.usefixtures("here")
def test_row_groups_and_columns_have_numbers() -> None:
    assert "has 1001 row groups; at most 1000" in refused(written(usual(1001), row_group_size=1))
    table = usual(1)
    for k in range(200):
        table = table.append_column(f"metric_{k}", pa.nulls(1, pa.float64()))
    assert f"{table.num_columns} columns; at most 200" in refused(written(table))


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("lacking", ["sigma", "weights", "estimator_version"])
def test_a_column_that_is_missing_is_named(lacking: str) -> None:
    assert f"has no column {lacking!r}" in refused(written(usual().drop_columns([lacking])))


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("weights", pa.array(["[[1.0]]"])),
        ("weights", pa.array([1.0])),
        ("sigma", pa.array(["0.1"])),
        ("seed", pa.array([1.0])),
        ("status", pa.array([b"ok"])),
        ("status", pa.array(["ok"]).dictionary_encode().cast(pa.large_string())),
        ("position_error", pa.array(["0.1"])),
    ],
)
def test_columns_have_the_types_of_rows(name: str, values: pa.Array) -> None:
    assert f"has '{name}' of type {values.type}" in refused(written(with_column(name, values)))


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("values", [[[1.0]], [[[1]]], [[[[1.0]]]], [[["1.0"]]]])
def test_weights_are_lists_of_lists_of_numbers(values: list) -> None:
    said = refused(written(with_column("weights", pa.array(values))))
    assert "has 'weights' of type list<" in said
    assert said.endswith(f"not {NUMBERS}")


@pytest.mark.usefixtures("here")
def test_names_of_columns_are_shown_cut_and_stand_there_once() -> None:
    table = usual(1)
    said = refused(written(table.append_column("x" * 5000, pa.array(["a"]))))
    assert "(5002 characters) of type string" in said
    twice = table.append_column("suite", pa.array(["a"]))
    assert "has two columns of one name" in refused(written(twice))


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    "data",
    [b"", b"PAR1", b"PAR1PAR1", b"x" * 10_000, b"PAR1" + b"\0" * 100 + b"\xff\xff\xff\x7fPAR1"],
)
def test_what_is_no_table_is_told_in_one_line(data: bytes) -> None:
    assert "cannot be read: " in refused(data)


@pytest.mark.parametrize("place", [0.2, 0.5, 0.9])
def test_damage_within_a_table_is_told_in_one_line(place: float) -> None:
    data = bytearray(written(usual(500), use_dictionary=False))
    start = int(place * len(data))
    data[start : start + 200] = bytes(range(200))
    refused(bytes(data))


def test_a_process_that_dies_is_told_in_one_line(monkeypatch) -> None:
    monkeypatch.setattr(parquet_rows, "_read", _die)
    assert "cannot be read: the process died" in refused(b"")


def _die(_data: bytes) -> bytes:
    os._exit(3)

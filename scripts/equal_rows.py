"""Check that the same trials, run in different ways, have the same rows.

    python scripts/equal_rows.py
    python scripts/equal_rows.py --seeds 5 --ways one two halves

Runs a part of the ``quick`` suite with one process, with two, on a Dask cluster of two, and in two
halves that are merged, and compares all columns but times. Exit code 1 if any differs.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

BENCH = [sys.executable, "-m", "olne_bench"]
#: Options of ``olne-bench run``; each list is one run, and several runs are merged.
WAYS = {
    "one": [["--jobs", "1"]],
    "two": [["--jobs", "2"]],
    "dask": [["--dask", "local:2"]],
    "halves": [["--sensor", "full"], ["--sensor", "partial"]],
}
TIMES = ["solve_seconds"]


def main() -> None:
    """Run in every way and compare with the first."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="noise draws")
    parser.add_argument("--sigma", nargs="+", default=["0.0", "0.01", "0.1"], help="noise levels")
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=list(WAYS))
    arguments = parser.parse_args()
    part = ["--seeds", str(arguments.seeds)]
    part += [word for sigma in arguments.sigma for word in ("--sigma", sigma)]
    equal = True
    with tempfile.TemporaryDirectory() as folder:
        tables = {way: _table(Path(folder, way), WAYS[way], part) for way in arguments.ways}
    first = arguments.ways[0]
    for way in arguments.ways[1:]:
        found = differences(tables[first], tables[way])
        equal &= not found
        said = "; ".join(found) if found else f"{len(tables[way])} equal rows"
        print(f"{first} and {way}: {said}")
    columns = tables[first].num_columns
    print(f"{'equal' if equal else 'NOT EQUAL'}: {columns} columns, all but {', '.join(TIMES)}")
    sys.exit(not equal)


def differences(one: pa.Table, other: pa.Table) -> list[str]:
    """Texts on what differs between two tables; empty if they are equal."""
    if one.column_names != other.column_names:
        return [f"columns {sorted(set(one.column_names) ^ set(other.column_names))}"]
    if len(one) != len(other):
        return [f"{len(one)} rows against {len(other)}"]
    found = []
    for name in one.column_names:
        pairs = zip(one[name].to_pylist(), other[name].to_pylist(), strict=True)
        differing = [f"{a!r} against {b!r}" for a, b in pairs if repr(a) != repr(b)]
        if differing:
            found.append(f"{name} in {len(differing)} rows, the first {differing[0]}")
    return found


def _table(out: Path, runs: Sequence[Sequence[str]], part: Sequence[str]) -> pa.Table:
    folders = [out.with_name(f"{out.name}{number}") for number in range(len(runs))]
    for folder, options in zip(folders, runs, strict=True):
        _call("run", "quick", "--no-figures", "--out", str(folder), *part, *options)
    if len(folders) > 1:
        _call("merge", *map(str, folders), "--out", str(out))
        _call("report", str(out), "--no-figures")
        folders = [out]
    return parquet.read_table(folders[0] / "trials.parquet").drop_columns(TIMES)


def _call(*arguments: str) -> None:
    done = subprocess.run([*BENCH, *arguments], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"olne-bench {' '.join(arguments)}: {done.stderr.splitlines()[-1]}")


if __name__ == "__main__":
    main()

"""Pack a run for a pull request: its rows, their provenance, and the code that made them."""

import shutil
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import KEY_COLUMNS, expand
from olne_bench.bench.plan.versions import files_of
from olne_bench.bench.report.gate import task_of
from olne_bench.bench.report.study import Study, study_in
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import Stored
from olne_bench.bench.run.store import Store, read_store
from olne_bench.bench.run.store_table import parquet_options, parse_nested, to_frame
from olne_bench.bench.submission.boards import board_files
from olne_bench.bench.submission.files import MOST_BYTES, MOST_FILES, digest
from olne_bench.bench.submission.manifest import (
    MANIFEST,
    PLUGINS,
    ROWS,
    check_labels,
    manifest_text,
    refuse_foreign_worlds,
)
from olne_bench.bench.submission.parquet_rows import MOST_ROWS
from olne_bench.errors import UserError
from olne_bench.files import whole_folder
from olne_bench.plugins import ESTIMATOR, is_built_in, is_file, source


def pack(folder: Path, name: str, out: Path) -> int:
    """Write a run's submission to a new folder, and return the number of its rows.

    UserError if a trial is missing or of other code, or a plugin is no file of an estimator.
    """
    if out.exists() or out.is_symlink():
        raise UserError(f"{out} exists already; remove it, or give another --name or --out")
    with read_store(folder) as store:
        runs = store.runs()
        if not runs:
            raise UserError(f"the run in {folder} has no finished trial yet")
        suites = [read_suite_json(run.suite) for run in runs]
        places = _plugin_places(suites)
        rows = _whole(store, runs, folder)
        study = replace(study_in(folder, store), confirmations=())
    if rows.num_rows > MOST_ROWS:
        raise UserError(f"{folder} has {rows.num_rows} rows, at most {MOST_ROWS} are allowed")
    with whole_folder(out) as unfinished:
        _copy_plugins(places, unfinished)
        _write_tables(rows, study, unfinished)
        packed = [_without_paths(run, places) for run in runs]
        _write_manifest(name, packed, unfinished)
    return int(rows.num_rows)


def _whole(store: Store, runs: Iterable[Provenance], folder: Path) -> pa.Table:
    """Rows of all trials that the runs were asked for."""
    stored, states, keys = Stored(store.records()), Counter[str](), set()
    for task in map(task_of, runs):
        for trial in expand(task.suite, task.seeds):
            if trial.key not in keys:
                keys.add(trial.key)
                states[stored.state(trial)] += 1
    again = "the same 'olne-bench run' command runs them"
    for state, what in (
        ("missing", f"are not run yet: {again}"),
        ("stale", f"were run with other code than the present one: {again} again"),
        (
            "harness_error",
            "could not be judged: 'olne-bench run --retry harness_error' tries them again",
        ),
    ):
        if states[state]:
            raise UserError(f"{states[state]} of {len(keys)} trials in {folder} {what}")
    table = store.table()
    key_parts = zip(*(table.column(name).to_pylist() for name in KEY_COLUMNS), strict=True)
    return table.filter(pa.array([tuple(map(str, parts)) in keys for parts in key_parts]))


def _plugin_places(suites: Iterable[Suite]) -> dict[str, str]:
    """The path of each plugin in the submission, by its reference."""
    places: dict[str, str] = {}
    for suite in suites:
        refuse_foreign_worlds(suite)
        check_labels(suite)
        for entry in suite.estimators:
            if entry.name in places or is_built_in(ESTIMATOR, entry.name):
                continue
            _refuse_installed(entry)
            file = source(ESTIMATOR, entry.name)[1]
            taken = {Path(place).parts[1] for place in places.values()}
            number = sum(
                part.rpartition("-")[0] == file.stem or part == file.stem for part in taken
            )
            folder = f"{file.stem}-{number + 1}" if number else file.stem
            class_name = entry.name.rpartition(".py")[2]
            places[entry.name] = f"{PLUGINS}/{folder}/{file.name}{class_name}"
    return places


def _refuse_installed(entry: EstimatorEntry) -> None:
    if not is_file(entry.name):
        raise UserError(
            f"estimator {entry.label!r} is of an installed package, whose source a submission "
            "cannot hold: run it from its file, with --plugin FILE.py"
        )


def _copy_plugins(places: dict[str, str], target: Path) -> None:
    for reference, place in places.items():
        first, *others = files_of(ESTIMATOR, reference)
        for file in (first, *others):
            outside = not file.resolve().is_relative_to(first.parent.resolve())
            if outside and file != first:
                raise UserError(f"{file} is a link out of its folder: put the file in its place")
            copy = (target / place).parent / file.relative_to(first.parent)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)


def _write_tables(rows: pa.Table, study: Study, target: Path) -> None:
    parsed = parse_nested(rows)
    parquet.write_table(parsed, target / ROWS, **parquet_options(parsed.schema))
    for name, text in board_files(to_frame(parsed), study).items():
        (target / name).write_text(text, encoding="utf-8", newline="")


def _without_paths(run: Provenance, places: dict[str, str]) -> Provenance:
    """A run's provenance that names plugins by their path in the submission."""
    suite = read_suite_json(run.suite)
    estimators = tuple(
        entry.model_copy(update={"name": places.get(entry.name, entry.name)})
        for entry in suite.estimators
    )
    packed = suite.model_copy(update={"estimators": estimators})
    return Provenance(**{**vars(run), "suite": packed.model_dump_json()})


def _write_manifest(name: str, runs: list[Provenance], target: Path) -> None:
    files = sorted(path for path in target.rglob("*") if path.is_file())
    size = sum(path.stat().st_size for path in files)
    if size > MOST_BYTES:
        raise UserError(
            f"the submission would have {size} bytes, at most {MOST_BYTES} are allowed: run fewer "
            "noise draws, or a smaller suite"
        )
    if len(files) > MOST_FILES:
        raise UserError(
            f"the submission would have {len(files)} files, at most {MOST_FILES} are allowed"
        )
    digests = {path.relative_to(target).as_posix(): digest(path.read_bytes()) for path in files}
    (target / MANIFEST).write_text(manifest_text(name, runs, digests), encoding="utf-8")

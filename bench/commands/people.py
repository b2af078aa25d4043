"""``olne-bench people``: how well recorded drivers are predicted."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import suppress
from datetime import date
from pathlib import Path

import click
import pandas as pd
from tqdm import tqdm

from olne_bench import __version__
from olne_bench.bench.people.cases import AHEAD, SEEN, Case, Source, cases_in, sources
from olne_bench.bench.people.study import rows_of, second_half, shown, summary
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.text import one_line
from olne_bench.errors import UserError
from olne_bench.files import check_folder, make_folder, whole_file

_OPENED, _ROWS, _SUMMARY, _PICTURE = "opened.json", "predictions.parquet", "summary.csv", "people"
_SUFFIXES = {"commonroad": ".xml", "sumo": ".xml"}


def people(data: Path, format_name: str, out: Path, second: bool, weights: bool, jobs: int) -> None:
    """Predict the drivers in DATA's recordings, and write errors, a table and a figure."""
    check_folder(out, (_ROWS, _SUMMARY, _OPENED, f"{_PICTURE}.png"))
    record = out / _OPENED
    found = _sources(data, format_name)
    pieces = {one.piece: one.road for one in found}
    held_out = second_half(pieces)
    digest = _digest([one.path for one in found if one.piece in held_out])
    if second:
        _refuse_opened(record, digest)
    wanted = [one for one in found if second or one.piece not in held_out]
    make_folder(out)
    cases = [*_cases(wanted, weights, jobs)]
    if not cases:
        with suppress(OSError):  # it was there before
            out.rmdir()
        raise UserError(
            f"{data}: no car in a lane has a leader and is seen for {SEEN + AHEAD:g} s, of which "
            f"the last {AHEAD:g} s would be predicted"
        )
    rows = rows_of(cases, held_out)
    if second:  # before anybody sees it
        opened = {**_before(record), digest: [str(date.today()), __version__]}
        with whole_file(record) as path:
            path.write_text(json.dumps(opened, indent=1))
    _write(rows, out)
    if not second and held_out:
        click.echo(f"{len(held_out)} pieces of recording are not opened; --open does so once")


def _sources(data: Path, format_name: str) -> list[Source]:
    """Recordings with lanes."""
    suffix = _SUFFIXES.get(format_name, ".csv")
    paths = sorted([*data.glob(f"*{suffix}"), *data.glob("*.parquet")]) if data.is_dir() else []
    if not paths:
        raise UserError(f"{data}: expected a folder of recordings ({suffix} or .parquet)")
    found = [*sources(tqdm(paths, unit="file", desc="reading"), format_name)]
    if not found:
        raise UserError(f"{data}: no recording has lanes, along which to predict")
    return found


def _digest(paths: Sequence[Path]) -> str:
    """What is in files."""
    whole = hashlib.sha256()
    for path in paths:
        whole.update(path.read_bytes())
    return whole.hexdigest()[:16]


def _before(record: Path) -> dict[str, list[str]]:
    """Which data were opened before."""
    return dict(json.loads(record.read_text())) if record.exists() else {}


def _refuse_opened(record: Path, digest: str) -> None:
    opened = _before(record).get(digest)
    if opened is not None:
        raise UserError(
            f"{record}: the second half of these recordings was opened on {opened[0]} (version "
            f"{opened[1]}); what is changed since then needs other recordings"
        )


def _cases(found: Sequence[Source], weights: bool, jobs: int) -> Iterator[Case]:
    """The cases of all sources, in their order."""
    with ProcessPoolExecutor(jobs) as pool:
        tasks = [pool.submit(cases_in, one, weights) for one in found]
        for _ in tqdm(as_completed(tasks), total=len(tasks), unit="file", desc="predicting"):
            pass
        for task in tasks:
            yield from task.result()


def _write(rows: pd.DataFrame, out: Path) -> None:
    from olne_bench.bench.report.figures import style
    from olne_bench.bench.report.figures.people_errors import errors_over_time

    with whole_file(out / _ROWS) as path:
        rows.round(3).to_parquet(path, index=False, compression="zstd")
    table = summary(rows)
    if table.empty:
        click.echo(f"{rows['piece'].nunique()} pieces of recording are too few for a summary")
        return
    write_csv(table.round(3), out / _SUMMARY)
    with style.applied():
        style.save(errors_over_time(table), out / _PICTURE, ["png"])
    named = table.assign(road=table["road"].map(one_line))
    with pd.option_context("display.width", 250):
        click.echo(shown(named).to_string(na_rep=""))
    click.echo(f"{out}: errors along the lane after {AHEAD:g} s, over those of driving straight on")

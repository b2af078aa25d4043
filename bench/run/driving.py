"""Runs drives, one after the other in one player process, and keeps their rows in a file.

A row is written as soon as its drive is over. What was interrupted goes on: drives that have a row
are not run again, unless it tells of a fault of the harness.
"""

import csv
from collections.abc import Iterable, Iterator
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pandas as pd

from olne_bench.bench.judge.driving import ERROR_COLUMNS, DriveRow, DriveTask, judge_drive
from olne_bench.bench.plan.salt import salt_id
from olne_bench.bench.process.child import StartError
from olne_bench.bench.run.stream_process import StreamProcess
from olne_bench.bench.text import clip, describe_error
from olne_bench.envs.drive.world import NoDriveError

Row = dict[str, Any]

#: What identifies a drive, and its planner.
KEY = ("road", "traffic", "weights", "sigma", "seed", "salt_id", "planner")
COLUMNS = (*KEY, *(one.name for one in fields(DriveRow) if one.name != "errors"), *ERROR_COLUMNS)

HARNESS_ERROR = "harness_error"


def run_drives(
    tasks: Iterable[DriveTask], *, memory: int | None, hidden: Path | None
) -> Iterator[Row]:
    """The row of each drive.

    A seed without a start has a row that is ``skipped``; a drive that cannot be judged has a
    ``harness_error``.

    Args:
        tasks: the drives.
        memory: memory limit [bytes] of the player process, None for no limit.
        hidden: folder that foreign code cannot read.

    Raises:
        StartError: if processes do not start.
    """
    player = StreamProcess(memory=memory, hidden=hidden)
    try:
        for task in tasks:
            yield key_of(task) | _row(task, player)
    finally:
        player.stop()


def key_of(task: DriveTask) -> Row:
    """What identifies a drive, by column."""
    rules = task.rules
    values = (task.road, task.traffic, task.weights, rules.sigma, task.seed)
    return dict(zip(KEY, (*values, salt_id(task.salt), task.planner), strict=True))


def _row(task: DriveTask, player: StreamProcess) -> Row:
    try:
        row = asdict(judge_drive(task, player))
    except NoDriveError as error:
        return {"status": "skipped", "message": clip(str(error))}
    except StartError:
        raise
    except Exception as error:  # a fault of ours must not end the study
        return {"status": HARNESS_ERROR, "message": describe_error(error)}
    return {name: value for name, value in row.items() if name != "errors"} | row["errors"]


class DriveFile:
    """The rows of a study, in a CSV file that grows by whole lines."""

    def __init__(self, path: Path) -> None:
        """Open a file that is there, or begin one. A line that was cut off is removed."""
        self._path = path
        if not path.exists():
            with path.open("w", encoding="utf-8", newline="") as file:
                csv.DictWriter(file, COLUMNS).writeheader()
            return
        text = path.read_bytes()
        whole = text[: text.rfind(b"\n") + 1]
        if len(whole) < len(text):
            path.write_bytes(whole)

    def read(self) -> pd.DataFrame:
        """All rows; where a drive has several, the last one."""
        rows = pd.read_csv(self._path, dtype={"salt_id": str, "message": str})
        return rows.drop_duplicates(list(KEY), keep="last", ignore_index=True)

    def done(self) -> set[tuple[str, ...]]:
        """Keys of drives that need not be run again."""
        rows = self.read()
        kept = rows[rows["status"] != HARNESS_ERROR]
        return {_as_text(dict(zip(KEY, key, strict=True))) for key in kept[list(KEY)].to_numpy()}

    def add(self, row: Row) -> None:
        """Write a row."""
        with self._path.open("a", encoding="utf-8", newline="") as file:
            csv.DictWriter(file, COLUMNS).writerow(row)


def is_done(task: DriveTask, done: set[tuple[str, ...]]) -> bool:
    """Whether a drive is among those of ``DriveFile.done``."""
    return _as_text(key_of(task)) in done


def _as_text(key: Row) -> tuple[str, ...]:
    numbers = ("sigma", "seed")
    return tuple(f"{float(key[name]):g}" if name in numbers else str(key[name]) for name in KEY)

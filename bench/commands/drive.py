"""``olne-bench drive``: let planners drive an ego among others, and count what it is worth."""

import signal
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import click
import msgspec
import numpy as np
import pandas as pd
from tqdm import tqdm

from olne_bench import plugins
from olne_bench.bench.commands.defaults import PLANNERS
from olne_bench.bench.commands.going_on import leave
from olne_bench.bench.judge.driving import judge_drive
from olne_bench.bench.plan.drive import OWN_PLANNERS, DriveTask, EstimateRules
from olne_bench.bench.plan.salt import check_salt
from olne_bench.bench.plan.versions import code_of_drive
from olne_bench.bench.report.driving import comparison_table, drive_table
from olne_bench.bench.report.escapes import csv_safe
from olne_bench.bench.report.figures.driving import draw_driving
from olne_bench.bench.run.cluster import check_cluster
from olne_bench.bench.run.drive_file import DriveFile, is_done, row_of
from olne_bench.bench.run.interrupt import stop_request
from olne_bench.bench.run.stream_process import StreamProcess
from olne_bench.bench.run.study import Machine, start
from olne_bench.envs.drive.cars import ROADS, STEP, STEPS
from olne_bench.envs.drive.first_cars import NoDriveError
from olne_bench.envs.drive.pictures import picture
from olne_bench.envs.video import SUFFIXES, check_format, write_video
from olne_bench.errors import UserError, bad_input
from olne_bench.files import check_folder, check_new_file, whole_file

#: Files of a study.
SETTINGS, EPISODES, SUMMARY, TESTS = "drive.json", "episodes.csv", "summary.csv", "tests.csv"

_SHOWN = ["drives", "collisions", "regret", "progress", "jerk", "fde_3s", "cycle_50", "cycle_99"]
_SHOWN += ["fallback", "late"]


def drive(out: Path | None, video: Path | None, **asked: Any) -> None:
    """Let planners drive 20 s among cars that plan again each second, and compare them."""
    seeds = range(asked["seeds"]) if video is None else (asked["seed"],)
    tasks = _tasks(seeds, **asked)
    if (out is None) == (video is None):
        raise UserError("drive needs either --out FOLDER, for a study, or --video FILE")
    if video is not None:
        _film(video, tasks, int(asked["memory"] * 2**30))
        return
    assert out is not None
    if asked["dask"] is not None:
        check_cluster(asked["dask"])
    file = _begun(out, asked)
    done = file.done()
    left = [task for task in tasks if not is_done(task, done)]
    click.echo(f"{len(left)} of {len(tasks)} drives are left", err=True)
    leave(_run(left, file, Machine(out, asked["jobs"], asked["dask"], asked["memory"])))
    _write_tables(file.read(_codes(file, tasks)), out, asked["figures"])


def _tasks(numbers: Sequence[int], **asked: Any) -> list[DriveTask]:
    """The drives, in the order in which they are run.

    Raises:
        UserError: on an unknown road or planner, a window longer than a drive, or a bad salt.
    """
    check_salt(asked["salt"])
    for road in asked["road"]:
        if road not in ROADS:
            raise UserError(f"--road {road!r} is unknown; known are: {', '.join(ROADS)}")
    if asked["window"] > STEPS:
        raise UserError(f"--window {asked['window']}: a drive has {STEPS} samples")
    planners = [_planner(name) for name in asked["planner"] or PLANNERS]
    labels = [label for label, *_ in planners]
    for label in labels:
        if labels.count(label) > 1:
            raise UserError(f"--planner {label!r} is named twice")
    rules = EstimateRules(asked["window"], asked["sigma"], asked["deadline"], asked["time_limit"])
    return [
        DriveTask(
            *(road, traffic, asked["weights"], seed, label, reference, plugin, rules),
            *(asked["salt"], code_of_drive(reference)),
        )
        for traffic, road, seed, (label, reference, plugin) in product(
            asked["traffic"], asked["road"] or tuple(ROADS), numbers, planners
        )
    ]


def _planner(name: str) -> tuple[str, str, str]:
    """Label, estimator and plugin of a planner.

    Raises:
        UserError: if there is none of this name.
    """
    if name in OWN_PLANNERS:
        return name, "", ""
    if plugins.is_file(name):
        plugins.source(plugins.ESTIMATOR, name)
        reference = plugins.absolute(name)
        return Path(name.partition(":")[0]).stem, reference, reference
    known = [*OWN_PLANNERS, *(one for one in plugins.names(plugins.ESTIMATOR))]
    if name not in known:
        names = ", ".join(dict.fromkeys(known))
        raise UserError(f"--planner {name!r} is unknown; known are: {names}, or FILE.py[:CLASS]")
    return name, name, "" if plugins.is_built_in(plugins.ESTIMATOR, name) else name


def _begun(out: Path, asked: dict[str, Any]) -> DriveFile:
    """The rows of a folder, which is new or has a study with the same settings.

    Raises:
        UserError: if it has not.
    """
    names = ("window", "deadline", "time_limit", "weights", "sigma", "salt")
    settings = {name: asked[name] for name in names}
    kept = out / SETTINGS
    check_folder(out, (SETTINGS,))
    if not kept.exists():
        out.mkdir(parents=True, exist_ok=True)
        with whole_file(kept) as path:
            path.write_bytes(msgspec.json.format(msgspec.json.encode(settings), indent=1))
    with bad_input(f"{kept} does not hold the settings of a study of drives", OSError):
        former = msgspec.json.decode(kept.read_bytes(), type=dict)
    for name, value in settings.items():
        if former.get(name) != value:
            option = name.replace("_", "-")
            raise UserError(
                f"--{option} {value!r} differs from that of the study in {out}, "
                f"{former.get(name)!r}; take that one or another folder"
            )
    return DriveFile(out / EPISODES)


def _run(left: list[DriveTask], file: DriveFile, machine: Machine) -> signal.Signals | None:
    """Run drives and keep their rows; the signal that interrupted them, if any."""
    ended = 0
    with (
        stop_request() as stop,
        tqdm(total=len(left), unit="drive", smoothing=0.05, mininterval=0.5) as bar,
    ):
        for task, outcome in start(left, machine, stop):
            file.add(row_of(task, outcome))
            ended += 1
            bar.update()
    if stop.signal is None or ended == len(left):
        return None
    click.echo(
        f"interrupted: {ended} drives are stored in {machine.out}, {len(left) - ended} remain; run "
        "the same command again to continue",
        err=True,
    )
    return stop.signal


def _codes(file: DriveFile, tasks: list[DriveTask]) -> dict[str, str]:
    """Code of each planner in a file; planners whose code is another one now are named."""
    codes = {task.planner: task.code for task in tasks}
    for label in file.read()["planner"].unique():
        if label not in codes:
            codes[label] = _code(label)
    stale = sorted(set(file.read()["planner"]) - set(file.read(codes)["planner"]))
    if stale:
        click.echo(f"not in the tables, as their code has changed: {', '.join(stale)}", err=True)
    return codes


def _code(label: str) -> str:
    """Code of a planner by its label; empty if it is not known here.

    A label is from the study's file, so it names no file that is to be read.
    """
    try:
        if plugins.is_file(label):
            return ""
        return code_of_drive(_planner(label)[1])
    except UserError:
        return ""


def _write_tables(rows: pd.DataFrame, out: Path, figures: bool) -> None:
    failed = rows[rows["status"] != "ok"]
    for (status, message), part in failed.groupby(["status", "message"], dropna=False):
        click.echo(f"{len(part)} drives {status}: {message}", err=True)
    table = drive_table(rows)
    if table.empty:
        raise UserError(f"{out}: no drive was driven; {EPISODES} says why")
    for name, whole in ((SUMMARY, table), (TESTS, comparison_table(rows))):
        with whole_file(out / name) as path:
            csv_safe(whole).to_csv(path, index=False)
    shown = table[["traffic", "road", "planner", *_SHOWN]]
    click.echo(
        "regret of the mean cost of a step (standing costs 1); medians in m, m/s^3, ms; shares"
    )
    click.echo(shown.to_string(index=False, float_format=lambda value: f"{value:.3g}", na_rep="-"))
    click.echo(f"{out}: {EPISODES} has a row for each drive, {TESTS} paired tests")
    if figures:
        draw_driving(table, out)
        click.echo(f"{out}: driving_*.png and .svg show regret against collisions")


def _film(video: Path, tasks: list[DriveTask], memory: int) -> None:
    """Write one drive as a video.

    Raises:
        UserError: on several drives, on a file that cannot be written, or a seed without a start.
    """
    check_new_file("--video", video, SUFFIXES)
    check_format(video)
    if len(tasks) != 1:
        raise UserError(
            f"--video shows one drive, and {len(tasks)} are asked for: name one --road, --traffic "
            "and --planner"
        )
    frames: list[np.ndarray] = []
    player = StreamProcess(memory=memory, hidden=None)
    try:
        row = judge_drive(tasks[0], player, lambda *now: frames.append(picture(*now)))
    except NoDriveError as error:
        raise UserError(str(error)) from error
    finally:
        player.stop()
    write_video(video, frames, fps=1 / STEP)
    what = "a collision" if row.collision else "no collision"
    click.echo(f"{video}: {len(frames)} frames, {what}; status {row.status} {row.message}".rstrip())

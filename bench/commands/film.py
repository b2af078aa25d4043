"""``olne-bench film``: drives of a suite as a video."""

from pathlib import Path

import click
import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.drives import driven
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, changed, select
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.run.check_study import check_kind
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.bench.run.player_process import PlayerProcess
from olne_bench.envs.drive.cars import STEP
from olne_bench.envs.drive.pictures import picture
from olne_bench.envs.drive.planner import EgoPlan
from olne_bench.envs.drive.starts import NoDriveError
from olne_bench.envs.drive.world import DriveWorld
from olne_bench.envs.worlds.video import SUFFIXES, check_format, write_video
from olne_bench.errors import UserError
from olne_bench.files import check_new_file

#: How long the last frame stays, with what the drive cost [s].
_AT_THE_END = 2.0


def film(
    road: str, out: Path, suite: str, planner: tuple[str, ...], seed: int, memory: float
) -> None:
    """Write the same start on ROAD, driven by each planner, as a video."""
    check_new_file("--out", out, SUFFIXES)
    check_format(out)
    drives = [_drive(road, suite, name, seed) for name in planner]
    try:
        reels = [_reel(drive, memory, small=len(drives) > 1) for drive in drives]
    except NoDriveError as error:
        raise UserError(str(error)) from error
    write_video(out, _beside(reels), fps=1 / STEP)
    click.echo(f"{out} is written")


def _reel(drive: Trial, memory: float, *, small: bool) -> list[np.ndarray]:
    """The frames of one drive; says how it went."""
    who = f"{drive.scenario.label}, draw {drive.seed}: {drive.estimator.label}"
    frames: list[np.ndarray] = []
    last: list[DriveWorld] = []

    def watch(world: DriveWorld, plan: EgoPlan | None) -> None:
        frames.append(picture(world, plan, f"{who} drives", small=small))
        last[:] = [world]

    player = PlayerProcess(memory=int(memory * 2**30), hidden=None)
    try:
        row = driven(drive, player, watch)
    finally:
        player.stop()
    cost = "" if row.cost is None else f", cost {row.cost:.3f}"
    what = "a collision" if row.collision else "no collision"
    click.echo(
        f"{who}: {len(frames)} frames, {what}{cost}; status {row.status} {row.message}".rstrip()
    )
    end = picture(last[0], None, f"{who}{cost}", small=small)
    return [*frames, *[end] * round(_AT_THE_END / STEP)]


def _beside(reels: list[list[np.ndarray]]) -> list[np.ndarray]:
    """One film of several, which stand still when they have ended; wide ones are stacked."""
    longest = max(map(len, reels))
    full = [[*reel, *[reel[-1]] * (longest - len(reel))] for reel in reels]
    height, width, _ = reels[0][0].shape
    return [
        np.concatenate(row, axis=0 if width > 2 * height else 1) for row in zip(*full, strict=True)
    ]


def _drive(road: str, reference: str, planner: str, seed: int) -> Trial:
    """A drive of a suite."""
    foreign = (planner,) if plugins.is_file(planner) else ()
    suite = load_suite(reference, foreign, describe_all)
    if suite.kind != "drives":
        raise UserError(f"--suite {reference!r} is a study of {suite.kind}, not of drives")
    label = suite.estimators[-1].label if foreign else planner
    chosen = Selection.model_construct(scenarios=(road,), estimators=(label,), seeds=seed + 1)
    part = select(changed(suite, chosen, describe_all), chosen)
    check_kind(part)
    return next(t for t in expand(part) if (t.seed, t.estimator.label) == (seed, label))

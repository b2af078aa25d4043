"""``olne-bench film``: one drive of a suite as a video."""

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
from olne_bench.envs.drive.starts import NoDriveError
from olne_bench.envs.worlds.video import SUFFIXES, check_format, write_video
from olne_bench.errors import UserError
from olne_bench.files import check_new_file


def film(road: str, out: Path, suite: str, planner: str, seed: int, memory: float) -> None:
    """Write one drive on ROAD as a video."""
    check_new_file("--out", out, SUFFIXES)
    check_format(out)
    drive = _drive(road, suite, planner, seed)
    frames: list[np.ndarray] = []
    caption = f"{road}, draw {seed}: {planner} drives"
    player = PlayerProcess(memory=int(memory * 2**30), hidden=None)
    try:
        row = driven(
            drive, player, lambda world, plan: frames.append(picture(world, plan, caption))
        )
    except NoDriveError as error:
        raise UserError(str(error)) from error
    finally:
        player.stop()
    write_video(out, frames, fps=1 / STEP)
    what = "a collision" if row.collision else "no collision"
    click.echo(f"{out}: {len(frames)} frames, {what}; status {row.status} {row.message}".rstrip())


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

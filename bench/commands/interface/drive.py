"""``olne-bench drive``: let planners drive an ego among others, and count what it is worth."""

from pathlib import Path
from typing import Any

import click

from olne_bench.bench.commands.defaults import DRIVING_SALT, PLANNERS
from olne_bench.bench.commands.interface.study_options import machine_options
from olne_bench.bench.commands.options import PATH, FiniteRange

#: Repeat those of ``envs.drive`` and ``plan.drive``, whose imports are slow.
TRAFFIC, WEIGHTS = ("nash", "stock"), ("temperaments", "dirichlet")
STEP, LEAST_WINDOW = 0.2, 2


@click.command()
@click.option("--out", type=PATH, help="Folder for the tables; one that is there is continued.")
@click.option("--video", type=PATH, help="Instead of a study, one drive as a film: MP4 or GIF.")
@click.option("--road", multiple=True, help="Only this road (repeatable). Default: all.")
@click.option(
    "--traffic",
    type=click.Choice(TRAFFIC),
    multiple=True,
    default=("nash",),
    show_default=True,
    help="Others that plan, or HighwayEnv's own drivers (repeatable).",
)
@click.option(
    "--weights",
    type=click.Choice(WEIGHTS),
    default=WEIGHTS[0],
    show_default=True,
    help="How hidden weights are drawn.",
)
@click.option(
    "--planner",
    multiple=True,
    help="Only this planner (repeatable): oracle, uniform, constant_velocity, stock, ppo, or "
    f"an estimator. Default: {', '.join(PLANNERS)}.",
)
@click.option("--seeds", type=click.IntRange(1, 10**6), default=4, show_default=True)
@click.option(
    "--seed", type=click.IntRange(0, 10**6), default=0, show_default=True, help="Of a film."
)
@click.option(
    "--sigma",
    type=FiniteRange(min=0),
    default=0.1,
    show_default=True,
    help="Noise on others' positions [m].",
)
@click.option(
    "--window",
    type=click.IntRange(min=LEAST_WINDOW),
    default=6,
    show_default=True,
    help="Number of latest samples that count.",
)
@click.option(
    "--deadline",
    type=FiniteRange(min=1e-3),
    default=STEP,
    show_default=True,
    help="Time in which an estimate has to be there [s].",
)
@click.option(
    "--time-limit",
    type=FiniteRange(min=1.0),
    default=300.0,
    show_default=True,
    help="Time after which an estimator is killed [s].",
)
@machine_options
@click.option(
    "--salt", default=DRIVING_SALT, show_default=True, metavar="TEXT", help="Seeds noise."
)
@click.option("--figures/--no-figures", default=True, show_default=True, help="Draw figures.")
def drive(out: Path | None, video: Path | None, **asked: Any) -> None:
    """Let planners drive 20 s among cars that plan again each second, and compare them.

    Each planner sees noisy samples of the others, five a second, and drives the first step of a
    plan. All planners begin at the same starts. A study that was interrupted goes on with the same
    command.
    """
    from olne_bench.bench.commands.drive import drive as work

    work(out, video=video, **asked)

"""Options that commands which run a suite share."""

from collections.abc import Callable, Sequence

import click

from olne_bench.bench.commands.options import JOBS, PATH, PLUGIN, Command, memory_option
from olne_bench.bench.plan.outcome import RETRIES

#: The options that say where trials run.
MACHINE_OPTIONS = (
    click.option(
        "--jobs",
        type=JOBS,
        default=2,
        show_default=True,
        help="Number of trials to run at the same time.",
    ),
    click.option(
        "--dask",
        metavar="ADDRESS",
        help="Dask cluster to run on: tcp://host:8786, or local:N for N workers on this machine.",
    ),
    memory_option("Memory limit of each worker process."),
)
_OPTIONS = (
    click.option(
        "--out",
        type=PATH,
        required=True,
        help="Run folder. An interrupted run continues.",
    ),
    *MACHINE_OPTIONS,
    click.option(
        "--retry",
        type=click.Choice(RETRIES),
        multiple=True,
        help="Run failed trials again: all, or those with this status (repeatable).",
    ),
    click.option(
        "--scenario",
        multiple=True,
        help="Only this scenario (repeatable).",
    ),
    click.option("--sensor", multiple=True, help="Only this sensor (repeatable)."),
    click.option(
        "--estimator",
        multiple=True,
        help="Only this estimator (repeatable).",
    ),
    click.option(
        "--sigma",
        type=float,
        multiple=True,
        help="Only this noise level (repeatable).",
    ),
    click.option(
        "--seeds",
        type=click.IntRange(1, 10**8),
        help="Number of noise draws to use, from the first on.",
    ),
    click.option(
        "--salt",
        metavar="TEXT",
        help="Text that seeds noise and draws; 'fresh' draws a secret one.",
    ),
    click.option(
        "--plugin",
        type=PLUGIN,
        multiple=True,
        metavar="FILE.py[:CLASS]",
        help="Add an estimator, scenario, sensor or metric from a file (repeatable).",
    ),
    click.option(
        "--figures/--no-figures", default=True, show_default=True, help="Draw figures at the end."
    ),
)


def study_options(command: Command) -> Command:
    """The options of a command that runs a suite (``going_on.StudyOptions``)."""
    return _with(_OPTIONS, command)


def machine_options(command: Command) -> Command:
    """The options that say where trials run, for a command that has the option ``--out``."""
    return _with(MACHINE_OPTIONS, command)


def _with(options: Sequence[Callable[[Command], Command]], command: Command) -> Command:
    for option in reversed(options):
        command = option(command)
    return command

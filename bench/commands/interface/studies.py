"""How the commands on studies are called."""

from typing import Any

import click

from olne_bench.bench.commands.options import (
    JOBS,
    PATH,
    PLUGIN,
    SUBMISSIONS,
    command,
    memory_option,
    several,
    shown,
)
from olne_bench.bench.plan.outcome import RETRIES
from olne_bench.bench.report.formats import FORMATS, USUAL_FORMATS

#: Repeats ``submission.fresh_draws.FEWEST``, whose import is slow.
FEWEST = 20
#: What judges most trials, and what players need: as of ``run.referee``, whose import is slow.
_JUDGES = ("bench.run.referee", "bench.run.player", "bench.judge.trials")


def _import_judges(dask: str | None, **_: Any) -> None:
    """Have what judges trials imported while this process imports what it needs itself."""
    if dask is None:
        from olne_bench.bench.process import nursery

        nursery.begin([f"olne_bench.{name}" for name in _JUDGES])


@command(first=_import_judges)
@click.argument("suite")
@click.option("--out", type=PATH, required=True, help="Run folder. An interrupted run continues.")
@shown("--jobs", type=JOBS, default=2, help="Number of trials to run at the same time.")
@click.option(
    "--dask",
    metavar="ADDRESS",
    help="Dask cluster to run on: tcp://host:8786, or local:N for N workers on this machine.",
)
@memory_option("Memory limit of each worker process.")
@several(
    "--retry",
    type=click.Choice(RETRIES),
    help="Run failed trials again: all, or those with this status (repeatable).",
)
@several("--scenario", help="Only this scenario (repeatable).")
@several("--sensor", help="Only this sensor (repeatable).")
@several("--estimator", help="Only this estimator (repeatable).")
@several("--sigma", type=float, help="Only this noise level (repeatable).")
@click.option(
    "--seeds",
    type=click.IntRange(1, 10**8),
    help="Number of noise draws to use, from the first on.",
)
@click.option(
    "--salt", metavar="TEXT", help="Text that seeds noise and draws; 'fresh' draws a secret one."
)
@several(
    "--plugin",
    type=PLUGIN,
    metavar="FILE.py[:CLASS]",
    help="Add an estimator, scenario, sensor or metric from a file (repeatable).",
)
@click.option(
    "--kind",
    type=click.Choice(("trials", "streams")),
    help="Kind of study to make of the suite: estimates at the end, or after each sample.",
)
@several(
    "--rule",
    metavar="NAME=VALUE",
    help="Rule that replaces one of the suite, such as lag=8 of streams (repeatable).",
)
@shown("--figures/--no-figures", default=True, help="Draw figures at the end.")
@shown(
    "--report/--no-report",
    default=True,
    help="Write tables, page and figures at the end; 'olne-bench report' writes them later.",
)
@shown("--formats", default="png", help=f"Formats of the figures: {', '.join(FORMATS)}.")
def run() -> None:
    """Run SUITE, a name or a TOML file. Options select a part of it, or change it.

    Scenarios, sensors, estimators and noise levels that the suite does not have replace those that
    it has, and so do another kind and rules. The changed suite has another name, and needs a run
    folder of its own. Trials that are in the run folder are not run again, unless the code of their
    scenario, sensor, estimator or scoring has changed.
    """


@command()
@click.argument("folder", type=PATH)
def status() -> None:
    """Show how far the run in FOLDER is.

    done: the result is valid, or the estimator declined the trial. failed: there is no valid
    result. harness_error: the trial could not be judged, which does not count against the
    estimator. stale: parameters or code of scenario, sensor, estimator or scoring have changed
    since. missing: not run yet. The time left of missing and stale trials is estimated from the
    mean time of each estimator's trials in this folder.
    """


@command()
@click.argument("folder", type=PATH)
@shown("--figures/--no-figures", default=True, help="Draw figures.")
@shown(
    "--formats",
    default=",".join(USUAL_FORMATS),
    help=f"Formats of the figures: {', '.join(FORMATS)}.",
)
@several(
    "--play",
    "playable",
    metavar="SIGMA:SEED",
    help="Noise level and seed of further trials that the page can play (repeatable).",
)
def report() -> None:
    """Write the tables, page and figures of the run in FOLDER again."""


@command()
@click.argument("before", type=PATH)
@click.argument("after", type=PATH)
@several(
    "--estimator",
    "estimators",
    metavar="NAME[=OTHER]",
    help="Compare only this estimator, which is called OTHER in AFTER (repeatable).",
)
@click.option("--out", type=PATH, help="New CSV file for the table.")
@click.option("--page", type=PATH, help="New .html file for a page that shows both runs.")
def compare() -> None:
    """Compare two runs trial by trial, on the same noise.

    It compares the errors that count in scores, and which trials fail. BEFORE and AFTER may be the
    same folder, to compare two estimators of one run.

    Exit code 0 if nothing got significantly worse (permutation test, 5 %, Holm's correction), 1 if
    something did, 2 on bad input.
    """


@command()
@click.argument("folder", type=PATH)
@click.option(
    "--suite", help="Use the limits of this suite, a name or a TOML file, instead of the run's own."
)
def gate() -> None:
    """Check the run in FOLDER against the limits in the [gate] table of its suite.

    Exit code 0 if all limits hold, 1 if one fails or the run is not finished, 2 on bad input.
    """


@command()
@click.argument("folder", metavar="RUN", type=PATH)
@shown(
    "--trials",
    type=click.IntRange(FEWEST, 10**6),
    default=FEWEST,
    help="Number of fresh trials for each estimator, scenario and sensor.",
)
@shown("--jobs", type=JOBS, default=2)
@memory_option("Memory limit of each worker process.")
def confirm() -> None:
    """Run fresh draws where rows of the run in RUN are implausible.

    Such rows have errors far below the statistical limit of their trial, and their estimator has no
    rank there. Fresh trials have other draws and other noise for each noise level and sensor. If
    their errors are as small, the estimator ranks: 'olne-bench report' shows it.

    Exit code 0 if all are confirmed, or nothing is implausible, 1 if one is not, 2 on bad input.
    """


@command()
@click.argument("first", type=PATH)
@click.argument("second", type=PATH)
@click.option(
    "--out", type=PATH, help="New run folder for the result. Without it, FIRST gets the rows."
)
def merge() -> None:
    """Add the trials of the run in SECOND to those of the run in FIRST.

    Both must be runs of the same suite, by the same rules; that of SECOND may have more estimators
    and scenarios. What they share must have the same code and parameters. If both have a trial, the
    row of FIRST is kept. SECOND does not change.
    """


@command()
@click.argument("suite")
@click.option("--out", type=PATH, help="File. Default: where 'olne-bench run' looks for it.")
@shown("--jobs", type=JOBS, default=2, help="Number of processes.")
@several("--scenario", help="Only this scenario (repeatable).")
@click.option("--seeds", type=click.IntRange(1, 10**8), help="Only the first draws, this many.")
def draws() -> None:
    """Solve all draws of SUITE and write them to a file, which 'olne-bench run' then uses.

    The file holds truths, equilibria and held-out starts. If it exists, the command goes on with it
    and adds what it lacks. Draws of plugins are not solved.
    """


@command()
@click.argument("folder", metavar="RUN", type=PATH)
@click.option("--name", help="Name of the submission. Default: that of the run folder.")
@click.option("--out", type=PATH, help=f"New folder. Default: {SUBMISSIONS}/NAME.")
def submit() -> None:
    """Pack the run in RUN for a pull request.

    The folder holds the rows, the leaderboard, the source of the estimators that are plugins, and
    their provenance: suite with salt, versions, commit, and hashes of the files. Every trial must
    have been run with the present code. 'olne-bench verify' checks the folder.
    """


@command()
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=PATH)
@click.option(
    "--sample",
    type=click.IntRange(1, 10**6),
    help="Number of rows of each plugin, and of all built-in estimators, to run again. "
    "Default: as many as find 5 % forged ones with 97 %, and the most suspicious.",
)
@click.option("--seed", type=click.IntRange(0), help="Seed of the choice of trials, to repeat it.")
@click.option("--strict", is_flag=True, help="Refuse rows of other versions of code or libraries.")
@shown("--jobs", type=JOBS, default=2)
@memory_option("Memory that a worker process may use.")
@click.option("--page", type=PATH, help="New .html file for a page of the accepted submissions.")
def verify() -> None:
    """Check the submissions in FOLDER..., as 'olne-bench submit' packs them.

    A sample of the rows is run again and must come out the same: bit by bit, or, with other
    versions of code or libraries, within 0.1 %. Plugins are run with fresh salts, too: they are
    refused if their errors there are significantly larger than the submitted ones. Where truths
    are fixed, they are run on drawn ones, as constants are known to everyone.

    Exit code 0 if all are accepted, 1 if one is not, 2 on bad input, such as a changed file.
    """

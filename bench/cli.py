"""The command line ``olne-bench`` (also ``python -m bench``)."""

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import click
from tqdm import tqdm

from bench.commands import COMMANDS
from bench.errors import UserError
from bench.executor import run_trials
from bench.report import format_leaderboard, write_report
from bench.store import open_store
from bench.suite import load_suite, select, suite_names
from bench.trial import expand
from envs.scenarios import scenario_names, scenario_options
from estimators.registry import EstimatorError, estimator_names
from games.observation import VIEWS


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
def cli() -> None:
    """A benchmark for inverse dynamic games."""


@cli.command()
@click.argument("suite")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help="Run folder; an interrupted run goes on.",
)
@click.option(
    "--jobs", type=click.IntRange(min=1), default=2, show_default=True, help="Worker processes."
)
@click.option("--scenario", multiple=True, help="Only this scenario (repeatable).")
@click.option("--view", multiple=True, help="Only this view (repeatable).")
@click.option("--estimator", multiple=True, help="Only this estimator (repeatable).")
@click.option("--sigma", type=float, multiple=True, help="Only this noise level (repeatable).")
@click.option("--seeds", type=click.IntRange(min=1), help="Only the first so many noise draws.")
@click.option(
    "--plugin",
    multiple=True,
    metavar="FILE.py[:CLASS]",
    help="Add an estimator from a file (repeatable).",
)
@click.option(
    "--figures/--no-figures", default=True, show_default=True, help="Draw the figures at the end."
)
def run(
    suite: str,
    out: Path,
    jobs: int,
    scenario: tuple[str, ...],
    view: tuple[str, ...],
    estimator: tuple[str, ...],
    sigma: tuple[float, ...],
    seeds: int | None,
    plugin: tuple[str, ...],
    figures: bool,
) -> None:
    """Run SUITE, a name or a TOML file, or the part of it that the options select."""
    whole = load_suite(suite, plugin)
    part = select(whole, scenarios=scenario, views=view, sigmas=sigma, estimators=estimator)
    if seeds is not None and seeds > whole.seeds:
        raise UserError(f"--seeds {seeds}: suite {whole.name!r} has {whole.seeds}")
    trials = list(expand(part, seeds))
    with open_store(out) as store:
        others = store.suites() - {whole.name}
        if others:
            raise UserError(f"{out} holds a run of suite {', '.join(others)!r}; use another --out")
        done = store.keys()
        pending = [trial for trial in trials if trial.key not in done]
        if len(pending) < len(trials):
            click.echo(
                f"{len(trials) - len(pending)} of {len(trials)} trials are done already", err=True
            )
        failures: Counter[str] = Counter()
        with tqdm(total=len(pending), unit="trial", smoothing=0.05, mininterval=0.5) as progress:
            for trial, outcome in run_trials(pending, jobs=jobs, log=out / "workers.log"):
                store.add(trial, outcome)
                if outcome.status != "ok":
                    failures[outcome.status] += 1
                    progress.set_postfix(failures, refresh=False)
                progress.update()
    _report(out, figures)


@cli.command(name="list")
def list_all() -> None:
    """List every suite, scenario, view and estimator."""
    click.echo("suites")
    for name in suite_names():
        click.echo(f"  {name:<20} {load_suite(name).description}")
    click.echo("scenarios")
    for name in scenario_names():
        options = scenario_options(name)
        click.echo(f"  {name:<20} {'options: ' + ', '.join(options) if options else ''}".rstrip())
    click.echo("views")
    for name in VIEWS:
        click.echo(f"  {name}")
    click.echo("estimators")
    for name in estimator_names():
        click.echo(f"  {name}")


@cli.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--figures/--no-figures", default=True, show_default=True, help="Draw the figures as well."
)
def report(folder: Path, figures: bool) -> None:
    """Write tables and figures of the run in FOLDER once more."""
    _report(folder, figures)


def _report(folder: Path, figures: bool) -> None:
    table = write_report(folder, figures=figures)
    click.echo(format_leaderboard(table))
    click.echo(
        f"\n{folder}: leaderboard.csv, trials.csv, trials.parquet"
        + (", figures/" if figures else "")
    )


for _command in COMMANDS:
    cli.add_command(_command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: bad input ends in one line on standard error and exit code 2."""
    try:
        cli.main(args=arguments, prog_name="olne-bench", standalone_mode=False)
    except (UserError, EstimatorError) as error:
        _fail(str(error))
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        sys.exit(2)
    except click.ClickException as error:
        _fail(error.format_message().rstrip(".") + _alternatives(error))
    except (KeyboardInterrupt, click.Abort):
        click.echo("\ninterrupted; run the same command again to go on", err=True)
        sys.exit(130)


def _alternatives(error: click.ClickException) -> str:
    """What could have been said in place of an unknown command or option."""
    context = getattr(error, "ctx", None)
    if context is None:
        return ""
    if isinstance(error, click.NoSuchOption):
        options = [p.opts[0] for p in context.command.params if isinstance(p, click.Option)]
        return f"; known are: {', '.join(options)}"
    if isinstance(context.command, click.Group):
        return f"; known are: {', '.join(context.command.list_commands(context))}"
    return f" (see '{context.command_path} --help')"


def _fail(message: str) -> None:
    click.echo(f"olne-bench: error: {' '.join(message.split())}", err=True)
    sys.exit(2)

"""The command line ``olne-bench`` (also ``python -m olne_bench``)."""

import sys
from collections.abc import Sequence

import click

from olne_bench.bench.commands import COMMANDS
from olne_bench.bench.plan.load import load_suite, suite_names
from olne_bench.envs.scenarios import scenario_names, scenario_options
from olne_bench.errors import UserError
from olne_bench.estimators.registry import EstimatorError, estimator_names
from olne_bench.games.observation import VIEWS


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
def cli() -> None:
    """A benchmark for inverse dynamic games."""


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

"""The command line ``olne-bench`` (also ``python -m olne_bench``)."""

import os
import sys
from collections.abc import Sequence

import click

from olne_bench import plugins
from olne_bench.bench.commands.interface import COMMANDS
from olne_bench.bench.text import one_line
from olne_bench.errors import UserError


class _Commands(click.Group):
    """Commands with the first sentence of their help, however long it is."""

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, first_sentence(one)) for name, one in sorted(COMMANDS.items())]
            )


def first_sentence(command: click.Command) -> str:
    """First sentence of a command's help."""
    text = " ".join((command.help or "").split("\n\n")[0].split())
    return text.split(". ")[0].rstrip(".") + "."


@click.group(
    cls=_Commands,
    commands=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="olne-bench", message="olne-bench %(version)s")
def cli() -> None:
    """A benchmark for inverse dynamic games."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line. Bad input prints one line to standard error and exits with code 2."""
    try:
        with plugins.loading():  # a command that imports a plugin itself names it
            cli.main(args=arguments, prog_name="olne-bench", standalone_mode=False)
    except UserError as error:
        _fail(str(error))
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        sys.exit(2)
    except click.ClickException as error:
        _fail(error.format_message().rstrip(".") + _alternatives(error))
    except BrokenPipeError:  # nobody reads what is said
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        place = f"{error.filename}: " if error.filename is not None else ""
        _fail(f"{place}{error.strerror or error}")
    except (KeyboardInterrupt, click.Abort):
        click.echo("\ninterrupted; run the same command again to continue", err=True)
        sys.exit(130)


def _alternatives(error: click.ClickException) -> str:
    """What to add to an error message: known commands or options, or where to find help."""
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
    click.echo(f"olne-bench: error: {one_line(message)}", err=True)
    sys.exit(2)

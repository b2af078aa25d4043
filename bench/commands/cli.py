"""The command line ``olne-bench`` (also ``python -m olne_bench``)."""

import ast
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.resources import files

import click

from olne_bench import plugins
from olne_bench.bench.commands import COMMANDS
from olne_bench.bench.text import one_line
from olne_bench.errors import UserError


class _Commands(click.Group):
    """Import a command when it is first used: importing all of them takes seconds."""

    def list_commands(self, context: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module = COMMANDS[name]
        found = import_module(f"{__package__}.{module}")
        command: click.Command = getattr(found, module.rpartition(".")[2])
        return command

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, _summary(module)) for name, module in COMMANDS.items()])


def _summary(module: str) -> str:
    """First sentence of a command's help, read from its source: nothing is imported."""
    *folders, name = module.split(".")
    file = files(__package__).joinpath(*folders, f"{name}.py")
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            text = " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split())
            return text.split(". ")[0].rstrip(".") + "."
    return ""


@click.group(
    cls=_Commands,
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

"""What the commands' interfaces share: a command that imports its work late, types, options."""

import csv
import json
import math
import re
from collections.abc import Callable
from functools import partial, update_wrapper
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import click

from olne_bench.errors import UserError

#: What an option decorates.
Command = TypeVar("Command", bound=Callable[..., Any])
#: Options whose default is shown, and options that may be repeated.
shown, several = partial(click.option, show_default=True), partial(click.option, multiple=True)

#: File systems allow names of 255 bytes. Files beside a given one have longer names than it.
_NAME_SIZE = 200
#: Folder of submissions in the repository.
SUBMISSIONS = Path("results/submissions")


def command(
    name: str | None = None, first: Callable[..., None] | None = None
) -> Callable[[Callable[[], None]], click.Command]:
    """Make a command of a function that has its options and help, and the name of its work.

    The work is the function of this name, in the module of this name in ``bench.commands``. It is
    imported when it is called, as that takes seconds. ``first`` is called before.
    """

    def decorated(called: Callable[[], None]) -> click.Command:
        def work(**given: Any) -> None:
            if first is not None:
                first(**given)
            module = import_module(f"olne_bench.bench.commands.{called.__name__}")
            getattr(module, called.__name__)(**given)

        return click.command(name or called.__name__)(update_wrapper(work, called))

    return decorated


class Finite(click.types.FloatParamType):
    """A finite number; click takes nan and infinity, too."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class FiniteRange(Finite, click.FloatRange):
    """A range of finite numbers."""


def number_pair(text: str) -> tuple[float, float]:
    """Two finite numbers, separated by a comma."""
    try:
        first, second = map(plain_number, text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a pair of numbers A,B.") from None
    if not (math.isfinite(first) and math.isfinite(second)):
        raise click.BadParameter(f"{text!r} is not a pair of finite numbers.")
    return first, second


def names(text: str) -> tuple[str, ...]:
    """Names, separated by commas; in quotes if they have commas."""
    found = next(csv.reader([text], skipinitialspace=True), [])
    return tuple(name.strip() for name in found)


def window(text: str) -> tuple[float, float]:
    """Two increasing times."""
    first, last = number_pair(text)
    if not first < last:
        raise click.BadParameter(f"{text!r} does not begin before it ends.")
    return first, last


class CleanPath(click.Path):
    """A path without control characters and names that are too long."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        problem = path_problem(str(value))
        if problem:
            self.fail(problem, param, ctx)
        return super().convert(value, param, ctx)


def _reference(text: str) -> str:
    """``path.py`` or ``path.py:Class``, or the name of an installed plugin."""
    problem = path_problem(text)
    if problem:
        raise click.BadParameter(problem)
    return text


def whole_number(text: str) -> int:
    """The number that a text of digits 0 to 9 stands for, of at most 18 of them."""
    if not re.fullmatch("[0-9]{1,18}", text):
        raise ValueError(f"{text!r} is not a whole number")
    return int(text)


def plain_number(text: str) -> float:
    """The number that a text stands for, such as -0.5 or 1e-3."""
    if not re.fullmatch(r" *[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,4})? *", text):
        raise ValueError(f"{text!r} is not a number")
    return float(text)


def path_problem(text: str) -> str:
    """What is wrong with the name of a file or folder; empty if nothing is."""
    from olne_bench.bench.plan import values  # pydantic takes long

    told = values.shown(text)
    if not text.strip():
        return f"{told} names no file or folder."
    if not text.isprintable():
        return f"a name cannot contain control characters or line breaks: {told}."
    if any(len(part.encode("utf-8", "replace")) > _NAME_SIZE for part in Path(text).parts):
        return f"a name has at most {_NAME_SIZE} bytes: {told}."
    return ""


PATH = CleanPath()
PLUGIN = click.types.FuncParamType(_reference)
#: Time limit of an estimate [s].
BUDGET = FiniteRange(min=0, min_open=True)
#: Memory [GiB], from what imports need to more than any machine has.
_MEMORY = FiniteRange(min=0.5, max=2**20)
#: Number of processes at the same time; more have never been tried.
JOBS = click.IntRange(1, 1024)


def memory_option(told: str) -> Callable[[Command], Command]:
    """The option ``--memory`` [GiB] with this help text."""
    return shown("--memory", type=_MEMORY, default=4.0, metavar="GIB", help=told)


def name_and_value(option: str, text: str, such: str = "num_players=3") -> tuple[str, Any]:
    """Both sides of NAME=VALUE; a value that is not JSON is text."""
    name, separator, value = text.partition("=")
    if not (name and separator):
        raise UserError(f"{option} {text!r}: expected NAME=VALUE, such as {such}")
    try:
        return name, json.loads(value)
    except (ValueError, RecursionError):  # numbers with too many digits, lists nested too deep
        return name, value

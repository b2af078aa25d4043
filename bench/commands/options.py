"""Options that several commands share."""

import json
import math
from typing import Any

import click

from olne_bench.errors import UserError


class FiniteRange(click.FloatRange):
    """A range of numbers without nan and infinity, which a plain one takes."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number.

        Raises:
            click.BadParameter: on anything else.
        """
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


#: A time that an estimator is told it has.
BUDGET = FiniteRange(min=0, min_open=True)
#: A process needs the least of these to import everything; no machine has the most.
MEMORY = FiniteRange(min=0.5, max=2**20)


def name_and_value(option: str, text: str) -> tuple[str, Any]:
    """Both sides of NAME=VALUE; a value that is no JSON is text.

    Raises:
        UserError: on any other text.
    """
    name, separator, value = text.partition("=")
    if not (name and separator):
        raise UserError(f"{option} {text!r}: expected NAME=VALUE, such as num_players=3")
    try:
        return name, json.loads(value)
    except (ValueError, RecursionError):  # numbers of too many digits, lists within lists
        return name, value

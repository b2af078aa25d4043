"""Options that several commands share."""

import math
from typing import Any

import click


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

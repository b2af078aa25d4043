"""How long a run still takes, by estimator, from what its trials have taken so far."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

#: Executor of a run on this machine, as ``Provenance.executor`` names it.
_LOCAL = re.compile("([0-9]{1,4}) local processes")


class Cost(NamedTuple):
    """What trials of an estimator in a scenario have taken: their number, and seconds in all."""

    trials: int
    seconds: float


@dataclass(frozen=True)
class TimeLeft:
    """What is left of an estimator's trials.

    Attributes:
        estimator: label of the estimator.
        trials: number of trials that are left.
        seconds: time that they take one after the other [s]; NaN if none has been run yet.
    """

    estimator: str
    trials: int
    seconds: float


def time_left(
    pending: Mapping[tuple[str, str], int], costs: Mapping[tuple[str, str], Cost]
) -> list[TimeLeft]:
    """The time left of each estimator with pending trials, in their order.

    A scenario's trials take as long as those of the estimator so far, on average: in the same
    scenario if there were any, else in all.

    Args:
        pending: number of trials by (scenario, estimator).
        costs: costs so far by (scenario, estimator).
    """
    left: dict[str, TimeLeft] = {}
    for (scenario, estimator), number in pending.items():
        if not number:
            continue
        own = [cost for (_, name), cost in costs.items() if name == estimator]
        cost = costs.get((scenario, estimator)) or _sum(own)
        seconds = number * cost.seconds / cost.trials if cost.trials else math.nan
        before = left.get(estimator, TimeLeft(estimator, 0, 0.0))
        left[estimator] = TimeLeft(estimator, before.trials + number, before.seconds + seconds)
    return list(left.values())


def processes(executor: str) -> int:
    """The number of processes of a run, from its executor; 1 if it does not say."""
    found = _LOCAL.fullmatch(executor)
    return int(found[1]) if found else 1


def in_words(seconds: float) -> str:
    """A duration in two units at most, such as ``3 h 20 min``."""
    if math.isnan(seconds):
        return "unknown"
    if seconds < 59.5:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    if hours < 24:
        return f"{hours} h {minutes} min"
    return f"{hours // 24} d {hours % 24} h"


def _sum(costs: Iterable[Cost]) -> Cost:
    all_of_them = list(costs)
    return Cost(sum(c.trials for c in all_of_them), sum(c.seconds for c in all_of_them))

"""Counts of the outcomes of planning on a road."""

from collections import deque
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

from highway_env.road.road import Road


@dataclass
class TrafficReport:
    """Counts of the outcomes of planning on one road.

    Attributes:
        solved: number of vehicle plans that are equilibria.
        shifted: number of times a vehicle continued its previous plan.
        braked: number of times a vehicle fell back on the Intelligent Driver Model, as it had no
            plan or only one that collides.
        seconds: the latest solving times [s], by number of vehicles that planned at once.
    """

    solved: int = 0
    shifted: int = 0
    braked: int = 0
    seconds: dict[int, deque[float]] = field(default_factory=dict)


_REPORTS: WeakKeyDictionary[Road, TrafficReport] = WeakKeyDictionary()


def traffic_report(road: Road) -> TrafficReport:
    """The report of a road, such as ``env.unwrapped.road``."""
    return _REPORTS.setdefault(road, TrafficReport())

"""How the plans of the Nash vehicles on a road came about."""

from collections import deque
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

from highway_env.road.road import Road


@dataclass
class TrafficReport:
    """How the plans on one road came about.

    Attributes:
        solved: vehicle plans that are equilibria.
        shifted: times a vehicle went on with its previous plan.
        braked: times a vehicle fell back on the Intelligent Driver Model, as it had no plan,
            or none that keeps clear of the others.
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

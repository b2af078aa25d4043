"""Traffic for any of HighwayEnv's environments that plays a receding-horizon Nash equilibrium.

Use it from a stock configuration::

    gym.make("highway-v0", config={"other_vehicles_type": "olne_bench.envs.traffic.NashVehicle"})

Every ``PLAN_STEP`` seconds, Nash vehicles near each other solve one open-loop game over the next
``STEPS`` plan steps, and each drives the first step of the solution. HighwayEnv still decides which
lane a vehicle takes (MOBIL and the planned route).

The ego, and any other vehicle that does not plan, is predicted to keep its lane and speed: its cost
is unknown, and who relied on its cooperation would collide with an ego that does not cooperate.
Nash vehicles of another group are predicted to follow their previous plans.

A group without an equilibrium plans apart: each answers what the others are expected to do. A
vehicle without a new plan follows the rest of its previous one. If that is used up, or if its plan
collides with something, as some do, it drives by the Intelligent Driver Model until the next
attempt, and stops before a car that crosses. Of two that would hit each other, one gives way: who
has the other more ahead. Whatever its plan, a vehicle brakes for the one ahead once that has to be
hard. ``traffic_report`` counts the cases.
"""

from typing import Any

from olne_bench.envs.traffic.joint_planning import TrafficReport, traffic_report
from olne_bench.envs.traffic.nash_vehicle import (
    AggressiveNashVehicle,
    CautiousNashVehicle,
    MixedNashVehicle,
    NashVehicle,
)
from olne_bench.envs.traffic.planning_vehicle import TEMPERAMENTS, Temperament, temperament

__all__ = [
    "TEMPERAMENTS",
    "AggressiveNashVehicle",
    "CautiousNashVehicle",
    "MixedNashVehicle",
    "NashVehicle",
    "Temperament",
    "TrafficReport",
    "temperament",
    "traffic_report",
]


def __getattr__(name: str) -> Any:
    """Name the known vehicles when HighwayEnv looks up an unknown ``other_vehicles_type``."""
    if name.startswith("_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    presets = sorted(known for known in __all__ if known.endswith("NashVehicle"))
    raise AttributeError(
        f"module {__name__!r} has no {name!r}; vehicles there are: {', '.join(presets)}"
    )

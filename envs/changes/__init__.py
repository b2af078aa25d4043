"""Worlds that are not what estimators are told: changes of a scenario, each with a dial.

A change is a dataclass with a ``name``, a ``dial`` whose 0 is the true model, and a method: a
*behaviour* or a *wrong model* drives the players (``drive``), a *wrong noise* changes errors
(``disturb``). To add one, write it in the file of its kind and list it here. The scenario
``changed`` applies them.
"""

from olne_bench.envs.changes.behaviours import (
    Alone,
    Entropic,
    Feedback,
    Leading,
    Replanning,
    Responding,
    Stock,
)
from olne_bench.envs.changes.change import Change
from olne_bench.envs.changes.wrong_models import (
    Goal,
    HiddenCost,
    LaneOffset,
    TargetSpeed,
    UnseenCars,
    VehicleLength,
    Wheelbase,
)
from olne_bench.envs.changes.wrong_noise import (
    Bias,
    ClockOffset,
    LaggedNoise,
    NoiseLevel,
    Outliers,
    StudentNoise,
)

__all__ = ["CHANGES", "Change", "make_change"]

CHANGES: dict[str, type[Change]] = {
    change.name: change
    for change in (
        *(Replanning, Feedback, Responding, Leading, Alone, Entropic, Stock),
        *(HiddenCost, TargetSpeed, Goal, LaneOffset, VehicleLength, Wheelbase, UnseenCars),
        *(NoiseLevel, StudentNoise, Outliers, LaggedNoise, Bias, ClockOffset),
    )
}


def make_change(name: str, dial: float) -> Change:
    """The change of a name at a dial.

    Raises:
        ValueError: on an unknown name, with the known ones, or a dial out of its range.
    """
    if name not in CHANGES:
        raise ValueError(f"there is no change {name!r}; known are: {', '.join(CHANGES)}")
    return CHANGES[name](dial)

"""Scenarios: games with ground truth. One file each; the file's name is the scenario's name.

A scenario module defines ``make(seed, **options) -> Scenario``. Put a new file into this folder
and ``get_scenario`` knows it.
"""

import inspect
from importlib import import_module
from pkgutil import iter_modules

from envs.scenarios.scenario import Scenario

__all__ = ["Scenario", "get_scenario", "scenario_names"]

_NOT_SCENARIOS = {"scenario"}


def scenario_names() -> list[str]:
    """Names of all scenarios."""
    return sorted(m.name for m in iter_modules(__path__) if m.name not in _NOT_SCENARIOS)


def get_scenario(name: str, seed: int | None = None, **options: object) -> Scenario:
    """Draw a scenario.

    Args:
        name: one of ``scenario_names()``.
        seed: which member of a family; a fixed scenario is the same for every seed. None
            stands for 0.
        **options: the scenario's own options, such as ``num_players`` of ``random``.

    Raises:
        ValueError: on an unknown name or option; the message names the alternatives.
    """
    if name not in scenario_names():
        raise ValueError(f"unknown scenario {name!r}; known are: {', '.join(scenario_names())}")
    make = import_module(f"{__name__}.{name}").make
    known = [p for p in inspect.signature(make).parameters if p != "seed"]
    for option in options:
        if option not in known:
            choice = ", ".join(known) or "none"
            raise ValueError(f"scenario {name!r} has no option {option!r}; known are: {choice}")
    return make(seed or 0, **options)

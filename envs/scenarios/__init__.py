"""Scenarios: games with ground truth. One file each; the file's name is the scenario's name.

A scenario module defines ``make(**options) -> Scenario``. A family of scenarios, of which every
seed draws another member, takes ``seed`` as its first argument; a fixed scenario does not. Where a
draw takes long, as one that is solved to be certified, the module also defines
``check(**options)``, which raises what ``make`` would. Put a new file into this folder and
``get_scenario`` knows it.
"""

import inspect
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

import numpy as np

from olne_bench.envs.scenarios.scenario import Scenario

__all__ = [
    "Scenario",
    "check_options",
    "checked_seed",
    "get_scenario",
    "is_family",
    "scenario_names",
    "scenario_options",
]

_NOT_SCENARIOS = {"scenario"}


def scenario_names() -> list[str]:
    """Names of all scenarios."""
    return sorted(m.name for m in iter_modules(__path__) if m.name not in _NOT_SCENARIOS)


def is_family(name: str) -> bool:
    """Whether another seed gives another member; a fixed scenario is the same for all.

    Raises:
        ValueError: on an unknown name.
    """
    return "seed" in _parameters(name)


def scenario_options(name: str) -> list[str]:
    """Names of a scenario's own options.

    Raises:
        ValueError: on an unknown name.
    """
    return [parameter for parameter in _parameters(name) if parameter != "seed"]


def get_scenario(name: str, seed: int | None = None, **options: object) -> Scenario:
    """Draw a scenario.

    Args:
        name: one of ``scenario_names()``.
        seed: which member of a family, 0 where absent; a fixed scenario ignores it.
        **options: the scenario's own options, such as ``num_players`` of ``random``.

    Raises:
        ValueError: on an unknown name or option (the message names the alternatives), or a value
            or seed that is none.
    """
    _check_names(name, options)
    draw = {"seed": checked_seed(seed)} if is_family(name) else {}
    return _module(name).make(**draw, **options)


def check_options(name: str, **options: object) -> None:
    """Refuse what ``get_scenario`` refuses, without the seconds that a draw may take.

    Raises:
        ValueError: on an unknown name or option, or a value that the scenario refuses.
    """
    _check_names(name, options)
    module = _module(name)
    getattr(module, "check", module.make)(**options)


def _check_names(name: str, options: dict[str, object]) -> None:
    known = scenario_options(name)
    for option in options:
        if option not in known:
            choice = ", ".join(known) or "none"
            raise ValueError(f"scenario {name!r} has no option {option!r}; known are: {choice}")


def checked_seed(seed: int | None) -> int:
    """The seed of a draw, 0 where absent.

    Raises:
        ValueError: unless it is an integer of at least 0.
    """
    if seed is None:
        return 0
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"a seed is an integer of at least 0, got {seed!r}")
    return int(seed)


def _parameters(name: str) -> list[str]:
    return list(inspect.signature(_module(name).make).parameters)


@cache  # asked for with every trial
def _module(name: str) -> ModuleType:
    if name not in scenario_names():
        raise ValueError(f"unknown scenario {name!r}; known are: {', '.join(scenario_names())}")
    return import_module(f"{__name__}.{name}")

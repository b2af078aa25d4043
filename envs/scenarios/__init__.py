"""Scenarios: games with ground truth. One file each; the file's name is the scenario's name.

A scenario is a class with a ``name``, fields that are its options, and ``draw``. A family, in which
each seed draws another member, has ``draw(self, seed)``; a fixed scenario has ``draw(self)``, or an
attribute ``fixed`` where its options decide. The constructor refuses bad options, without drawing.
``get_scenario`` finds new files in this folder, installed packages and other files.
"""

import numpy as np

from olne_bench.checks import as_text
from olne_bench.envs.scenarios.scenario import NoEquilibriumError, Scenario
from olne_bench.plugins import (
    SCENARIO,
    PluginError,
    at_home,
    describe_foreign_error,
    find_class,
    is_built_in,
    make,
    names,
    parameter_names,
    takes_seed,
)

__all__ = [
    "Scenario",
    "check_options",
    "checked_seed",
    "get_scenario",
    "is_family",
    "scenario_names",
    "scenario_options",
]

_SEED_LIMIT = 2**63  # tables hold seeds as 64-bit integers


def scenario_names() -> list[str]:
    """Names of the built-in and the installed scenarios."""
    return names(SCENARIO)


def is_family(name: str, **options: object) -> bool:
    """Whether each seed draws another member; PluginError on options as ``check_options``."""
    return takes_seed(check_options(name, **options))


def scenario_options(name: str) -> list[str]:
    """Names of a scenario's own options; PluginError as ``is_family`` does."""
    return parameter_names(find_class(SCENARIO, name))


def get_scenario(name: str, seed: int | None = None, **options: object) -> Scenario:
    """Draw a scenario by name, one of ``scenario_names()``, or ``path.py`` / ``path.py:Class``.

    The seed says which member of a family, 0 by default; a fixed scenario ignores it. The options
    are the scenario's own, such as ``num_players`` of ``random``. Raises PluginError on an unknown
    name or option (the message names the alternatives), a value that the scenario refuses, or a
    foreign scenario that does not draw a ``Scenario``; ValueError on an invalid seed;
    NoEquilibriumError if a family finds no member that can be played.
    """
    plugin = check_options(name, **options)
    arguments = (checked_seed(seed),) if takes_seed(plugin) else ()
    if is_built_in(SCENARIO, name):
        drawn: Scenario = plugin.draw(*arguments)  # type: ignore[attr-defined]
        return drawn
    try:
        with at_home(plugin):
            foreign = plugin.draw(*arguments)  # type: ignore[attr-defined]
    except NoEquilibriumError:
        raise
    except BaseException as error:
        raise PluginError(
            f"scenario {name!r} cannot be drawn: {describe_foreign_error(error)}"
        ) from error
    if type(foreign) is not Scenario:
        raise PluginError(f"scenario {name!r} has to draw an olne_bench.envs.scenarios.Scenario")
    return foreign


def check_options(name: str, **options: object) -> object:
    """The plugin, ready to draw. It checks options without a draw, which may take seconds.

    Raises PluginError on an unknown name or option, or a value that the scenario refuses.
    """
    known = scenario_options(name)
    for option in options:
        if option not in known:
            choice = ", ".join(known) or "none"
            raise PluginError(f"scenario {name!r} has no option {option!r}; known are: {choice}")
    return make(SCENARIO, name, options)


def checked_seed(seed: int | None) -> int:
    """The seed of a draw, by default 0; ValueError unless an integer of at least 0, below 2**63."""
    if seed is None:
        return 0
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"a seed is an integer of at least 0, got {seed!r}")
    if seed >= _SEED_LIMIT:
        raise ValueError(f"a seed is an integer below 2**63, got {as_text(seed)}")
    return int(seed)

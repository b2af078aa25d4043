"""Make the world that plays a scenario."""

from importlib import import_module
from typing import Any

from olne_bench.envs.olne_v0 import OlneWorld
from olne_bench.envs.scenarios.scenario import Scenario


def make_world(scenario: Scenario, **arguments: Any) -> OlneWorld:
    """The PettingZoo world that a scenario names, for this scenario.

    The world's module is imported at its first use, because importing a simulator takes a second.

    Args:
        scenario: the scenario.
        **arguments: of the world, such as ``render_mode``.

    Raises:
        ValueError: on a scenario without ``limits``.
    """
    world: OlneWorld = import_module(f"olne_bench.envs.{scenario.world}").parallel_env(
        scenario, **arguments
    )
    return world

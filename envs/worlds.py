"""Which world plays a scenario."""

from importlib import import_module

from olne_bench.envs.olne_v0 import OlneWorld
from olne_bench.envs.scenarios.scenario import Scenario


def make_world(scenario: Scenario, render_mode: str | None = None) -> OlneWorld:
    """The PettingZoo world that the scenario names, made for this scenario.

    A world is imported at its first use: a simulator takes a second that studies without it save.

    Raises:
        ValueError: on a scenario without ``limits``.
    """
    world: OlneWorld = import_module(f"olne_bench.envs.{scenario.world}").parallel_env(
        scenario, render_mode=render_mode
    )
    return world

"""Which world plays a scenario."""

from importlib import import_module

from olne_bench.envs.olne_v0 import OlneWorld
from olne_bench.envs.scenarios.scenario import Scenario


def make_world(scenario: Scenario, render_mode: str | None = None) -> OlneWorld:
    """The PettingZoo world that the scenario names, made for this scenario.

    The world's module is imported at its first use. Importing a simulator takes a second, which
    studies without it need not spend.

    Raises:
        ValueError: on a scenario without ``limits``.
    """
    world: OlneWorld = import_module(f"olne_bench.envs.{scenario.world}").parallel_env(
        scenario, render_mode=render_mode
    )
    return world

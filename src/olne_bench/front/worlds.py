"""Worlds of several agents."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from olne_bench.envs.olne_v0 import make_world
from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.envs.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from olne_bench.envs.olne_v0 import OlneWorld


def parallel_env(scenario: str | Scenario = "highway", **arguments: Any) -> "OlneWorld":
    """The PettingZoo world that plays a scenario, on HighwayEnv's roads where it has one.

    Args:
        scenario: a name, whose ``reset(seed=...)`` draws another member, or a scenario.
        **arguments: of the world, such as ``render_mode="rgb_array"``.

    Raises:
        ValueError: on an unknown name, with the alternatives, or a scenario without limits.
    """
    if isinstance(scenario, Scenario):
        return make_world(scenario, **arguments)
    module = "highway_v0" if scenario in ROAD_NAMES else "olne_v0"
    world: OlneWorld = import_module(f"olne_bench.envs.{module}").parallel_env(
        scenario, **arguments
    )
    return world

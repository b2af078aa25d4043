"""Gymnasium environments: HighwayEnv's ego among traffic that plays a Nash equilibrium.

All but the other vehicles is HighwayEnv's own; they are ``NashVehicle`` unless
``config["other_vehicles_type"]`` names another class. ``import olne_bench.envs`` registers the ids
(``envs.worlds.gym_ids``); this module is imported when one of them is made.
"""

from typing import Any

from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.highway_env import HighwayEnvFast
from highway_env.envs.intersection_env import ConnectedLaneIntersectionEnv
from highway_env.envs.merge_env import ConnectedLaneMergeEnv
from highway_env.envs.roundabout_env import ConnectedLaneRoundaboutEnv
from highway_env.envs.two_way_env import TwoWayEnv

from olne_bench.envs.traffic import NashVehicle


class IntersectionNashVehicle(NashVehicle):
    """A Nash vehicle for intersections.

    HighwayEnv's intersection changes attributes of its vehicles' class. With a shared class, the
    change would affect all other roads of the process.
    """


class _NashTraffic(AbstractEnv):
    """A mixin that makes the other vehicles of one of HighwayEnv's environments Nash vehicles."""

    VEHICLE: type[NashVehicle] = NashVehicle

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        vehicle = f"{cls.VEHICLE.__module__}.{cls.VEHICLE.__qualname__}"
        config: dict[str, Any] = super().default_config()
        return config | {"other_vehicles_type": vehicle}


class NashHighwayEnv(_NashTraffic, HighwayEnvFast):
    """HighwayEnv's ``highway-fast-v0`` among Nash traffic.

    Vehicles of the traffic have no collisions with each other, as there.
    """


class NashMergeEnv(_NashTraffic, ConnectedLaneMergeEnv):
    """HighwayEnv's ``merge-v1`` among Nash traffic."""


class NashRoundaboutEnv(_NashTraffic, ConnectedLaneRoundaboutEnv):
    """HighwayEnv's ``roundabout-v1`` among Nash traffic."""


class NashIntersectionEnv(_NashTraffic, ConnectedLaneIntersectionEnv):
    """HighwayEnv's ``intersection-v2`` among Nash traffic."""

    VEHICLE = IntersectionNashVehicle


class NashTwoWayEnv(_NashTraffic, TwoWayEnv):
    """HighwayEnv's ``two-way-v0`` among Nash traffic; an episode has at most 15 steps, as there."""

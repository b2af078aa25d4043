"""PettingZoo world on HighwayEnv's own simulator, whose open-loop Nash equilibrium is known.

``parallel_env`` is the world; ``raw_env`` and ``env`` are its turn-based (AEC) forms.
"""

from typing import Any, ClassVar

import numpy as np
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from olne_bench.envs.olne_v0 import AecWorld, OlneWorld
from olne_bench.envs.roads.highway_roads import ROAD_NAMES, make_road
from olne_bench.envs.roads.simulated_roads import PlayersOnly
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.worlds.episode import Episode
from olne_bench.envs.worlds.layout import player_name
from olne_bench.games.solve.olne import Equilibrium

__all__ = ["HighwayWorld", "env", "parallel_env", "raw_env"]


class HighwayWorld(OlneWorld):
    """``envs.olne_v0.OlneWorld`` on HighwayEnv's simulator, roads and pictures.

    All but what follows is as there, in metres. The motion model is HighwayEnv's vehicle. Its state
    is px [m], py [m], heading [rad] and speed [m/s]; its control is steering [rad] within pi/3 and
    acceleration [m/s^2] within 12, held for 0.4 s.

    After a collision, the car's player terminates alone, leaves ``agents`` and takes no more
    actions; the others continue to the end of the game. Scenarios are drawn such that the OLNE
    replays exactly and is free of collisions, including those that HighwayEnv only predicts.

    **Pictures** are HighwayEnv's: the y axis points **down**. Headings therefore grow clockwise in
    pictures, and positive steering turns a car to its right as seen there.

    Args:
        scenario: one of ``envs.roads.highway_roads.ROAD_NAMES`` or a ``Scenario`` of that name.
        **arguments: those of ``OlneWorld``.

    Raises:
        ValueError: on a scenario that has no road in HighwayEnv, and as ``OlneWorld``.

    Version history:
        * v0: first version.
    """

    metadata: ClassVar[dict[str, Any]] = OlneWorld.metadata | {"name": "highway_v0"}

    def __init__(self, scenario: str | Scenario = "highway", **arguments: Any) -> None:
        _check_has_road(scenario)
        self._roads: dict[str, PlayersOnly] = {}
        super().__init__(scenario, **arguments)

    @property
    def crashed(self) -> frozenset[str]:
        """Players that have left this episode after a collision; or ResetNeeded."""
        return frozenset(player_name(index) for index in self._latest_episode().left)

    def render(self) -> np.ndarray | None:
        """The present state as a (height, width, 3) uint8 array, or in a window."""
        episode = self._latest_episode()
        if self.render_mode is None:
            return super().render()
        return self._roads[episode.scenario.name].render()

    def close(self) -> None:
        for road in self._roads.values():
            road.close()

    def _choice(self, options: dict[str, Any] | None) -> tuple[str | Scenario, dict[str, Any]]:
        scenario, scenario_options = super()._choice(options)
        _check_has_road(scenario)
        return scenario, scenario_options

    def _new_episode(self, scenario: Scenario, truth: Equilibrium | None) -> Episode:
        name = scenario.name
        if name not in self._roads:
            self._roads[name] = make_road(name, self.render_mode)
        return _SimulatedEpisode(scenario, truth, self._roads[name])

    def _new_renderer(self) -> None:
        return None  # HighwayEnv draws itself


class _SimulatedEpisode(Episode):
    """An episode in which HighwayEnv moves the cars."""

    def __init__(self, scenario: Scenario, truth: Equilibrium | None, road: PlayersOnly) -> None:
        super().__init__(scenario, truth)
        self._road = road
        road.place(scenario.initial_state)

    def _move(self, controls: np.ndarray) -> np.ndarray:
        self._road.apply(controls)
        self.left = frozenset(np.flatnonzero(self._road.crashed()).tolist())
        return self._road.states()


def raw_env(scenario: str | Scenario = "highway", **arguments: Any) -> AecWorld:
    """The world with the turn-based (AEC) interface; arguments as for ``parallel_env``."""
    return AecWorld(HighwayWorld(scenario, **arguments))


def env(scenario: str | Scenario = "highway", **arguments: Any) -> OrderEnforcingWrapper:
    """``raw_env`` with PettingZoo's checks of the order of calls."""
    return OrderEnforcingWrapper(raw_env(scenario, **arguments))


parallel_env = HighwayWorld


def _check_has_road(scenario: str | Scenario) -> None:
    name = scenario if isinstance(scenario, str) else scenario.name
    if name not in ROAD_NAMES:
        raise ValueError(
            f"scenario {name!r} has no road in HighwayEnv; known are: {', '.join(ROAD_NAMES)}"
        )

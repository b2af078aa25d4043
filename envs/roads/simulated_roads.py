"""HighwayEnv's environments with the players on them, and without its random traffic and rewards.

The simulator is HighwayEnv's own: its road networks, vehicles and ``step``. Importing it takes a
second, so that ``envs.roads.highway_roads`` does it where a road is needed.
"""

from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.graphics import EnvViewer
from highway_env.envs.highway_env import HighwayEnv
from highway_env.envs.intersection_env import IntersectionEnv
from highway_env.envs.merge_env import MergeEnv
from highway_env.envs.roundabout_env import RoundaboutEnv
from highway_env.envs.two_way_env import TwoWayEnv
from highway_env.vehicle.kinematics import Vehicle

from olne_bench.envs.worlds.window import Window

_PALETTE: tuple[tuple[int, int, int], ...] = (
    (228, 87, 70),
    (70, 130, 220),
    (240, 190, 60),
    (120, 190, 90),
    (170, 110, 200),
    (90, 200, 200),
    (240, 140, 60),
    (200, 120, 150),
)


class _CushionedVehicle(Vehicle):
    """A vehicle with a margin around it in collisions; its motion is that of its class."""

    def __init__(self, *args: Any, margin: float, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._margin = margin  # [m] on each side
        self.diagonal += 2 * np.sqrt(2) * margin

    def polygon(self) -> np.ndarray:
        cos, sin = self.direction
        rotation = np.array([[cos, -sin], [sin, cos]])
        corners = (super().polygon() - self.position) @ rotation
        return np.asarray((corners + self._margin * np.sign(corners)) @ rotation.T + self.position)


class PlayersOnly(AbstractEnv):
    """A mixin for HighwayEnv's environments that replaces random traffic by the players."""

    #: Centre of pictures [m]; None follows the cars.
    camera: tuple[float, float] | None = (0.0, 0.0)
    #: Entries of HighwayEnv's configuration for pictures.
    picture: ClassVar[dict[str, Any]] = {}
    #: Window for pictures; None returns them to the caller.
    window: Window | None = None
    viewer: EnvViewer | None
    initial_state = np.empty((0, 4))
    margin = 0.0

    @classmethod
    def default_config(cls) -> dict[str, Any]:
        config: dict[str, Any] = super().default_config()
        # Ranges of [-1, 1] make HighwayEnv's map from actions to controls the identity.
        physical = {"acceleration_range": [-1.0, 1.0], "steering_range": [-1.0, 1.0]}
        control = {"type": "ContinuousAction", "clip": False, **physical}
        attributes = {"type": "AttributesObservation", "attributes": []}
        return config | {
            "action": {"type": "MultiAgentAction", "action_config": control},
            "observation": attributes,  # the world observes its players itself
            "spawn_probability": 0.0,
            "centering_position": [0.5, 0.5],
            **cls.picture,
        }

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"viewer": None}  # a viewer cannot be pickled, and is made again

    def render(self) -> np.ndarray | None:
        """The picture (height, width, 3) uint8, or None if it was shown in the window."""
        if self.viewer is None:
            self.viewer = EnvViewer(self)
            # HighwayEnv draws black frames with SDL's dummy driver, but arrays need no driver.
            self.viewer.enabled = True
        where = self.states()[:, :2].mean(axis=0) if self.camera is None else self.camera
        self.viewer.observer_vehicle = SimpleNamespace(position=np.array(where))
        picture: np.ndarray = super().render()
        if self.window is None:
            return picture
        for event in self.window.show(picture):
            self.viewer.sim_surface.handle_event(event)  # HighwayEnv's keys to zoom
        return None

    def close(self) -> None:
        if self.window is not None:
            self.window.close()
        self.viewer = None  # HighwayEnv's close would shut pygame down for all worlds

    def place(self, states: np.ndarray, margin: float = 0.0) -> None:
        """Reset with a vehicle for each state (N, 4), wider by the margin [m] on each side."""
        self.initial_state = np.asarray(states, dtype=float)
        self.margin = margin
        self.reset()

    def apply(self, controls: np.ndarray) -> None:
        """Simulate one action: controls (N, 2) steering [rad], acceleration [m/s^2]."""
        # HighwayEnv's order is acceleration, steering. Python floats keep double precision.
        self.step(tuple((float(a), float(s)) for s, a in controls))

    def states(self) -> np.ndarray:
        """(N, 4) present states of the vehicles."""
        rows = [[*v.position, v.heading, v.speed] for v in self.controlled_vehicles]
        return np.array(rows).reshape(-1, 4)

    def crashed(self) -> np.ndarray:
        """(N,) whether each vehicle is in a collision."""
        return np.array([v.crashed for v in self.controlled_vehicles])

    def _make_vehicles(self, *_: object) -> None:
        self.controlled_vehicles = []
        for index, (px, py, heading, speed) in enumerate(self.initial_state):
            where = (self.road, [px, py], float(heading), float(speed))
            vehicle = (
                _CushionedVehicle(*where, margin=self.margin) if self.margin else Vehicle(*where)
            )
            vehicle.color = _PALETTE[index % len(_PALETTE)]
            self.controlled_vehicles.append(vehicle)
        self.road.vehicles = list(self.controlled_vehicles)

    def _create_vehicles(self) -> None:  # the name in other environments of HighwayEnv
        self._make_vehicles()

    def _automatic_rendering(self) -> None:
        if self.window is not None:  # only a window shows frames between two actions
            super()._automatic_rendering()

    def _info(self, obs: object, action: object = None) -> dict[str, Any]:
        return {}

    def _reward(self, action: object) -> float:
        return 0.0

    def _is_terminated(self) -> bool:
        return False

    def _is_truncated(self) -> bool:
        return False


class _Highway(PlayersOnly, HighwayEnv):
    camera = None
    picture: ClassVar = {"screen_width": 1200, "scaling": 4.5}


class _Merge(PlayersOnly, MergeEnv):
    camera = None
    picture: ClassVar = {"screen_width": 1200}


class _TwoWay(PlayersOnly, TwoWayEnv):
    camera = None
    picture: ClassVar = {"screen_width": 1200, "scaling": 3.4}


class _Roundabout(PlayersOnly, RoundaboutEnv):
    pass


class _Intersection(PlayersOnly, IntersectionEnv):
    pass


#: The environments by the names of ``envs.roads.highway_roads.ROAD_NAMES``.
ROADS: dict[str, type[PlayersOnly]] = {
    "highway": _Highway,
    "intersection": _Intersection,
    "merge": _Merge,
    "roundabout": _Roundabout,
    "two_way": _TwoWay,
}

"""Observation models h (eqn. awgn_observation): what a sensor is expected to see of one state.

A view is data plus one CasADi expression, so estimators differentiate the very function that
generates the observations. The noise that sensors add is not part of it.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import casadi as ca
import numpy as np


class Components(Hashable, Protocol):
    """Anything that names the components of a state: a motion model, or a sensor's report."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the n components."""

    @property
    def state_size(self) -> int:
        """N."""


class View(ABC):
    """An observation model, applied to each player's state on its own.

    Views are frozen dataclasses: solvers are built once per view and found again by its hash.

    Attributes:
        name: short name, used in suites and tables.
    """

    name: str

    @abstractmethod
    def expected(self, state: ca.SX, dynamics: Components) -> ca.SX:
        """h(x): expected observation (d,) of one player's state (n,)."""

    def component_names(self, dynamics: Components) -> tuple[str, ...]:
        """Names of the d observed components."""
        return tuple(f"{self.name}_{k}" for k in range(observation_size(self, dynamics)))

    def bounds(
        self, low: np.ndarray, high: np.ndarray, dynamics: Components
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (d,) of the observations of states within bounds (n,); infinite if unknown."""
        limit = np.full(observation_size(self, dynamics), np.inf)
        return -limit, limit

    def noise_scale(self, scale: np.ndarray, dynamics: Components) -> np.ndarray:
        """Relative standard deviations (d,) of observations of states with those of scale (n,).

        Where a view mixes components, the noise on what it shows has no fixed scale; all of it
        then counts alike.
        """
        return np.ones(observation_size(self, dynamics))

    def read_off(self, y: np.ndarray, dynamics: Components) -> dict[str, np.ndarray]:
        """State components (...) that observations (..., d) determine, by name.

        Solvers start from them; a view that determines none is a view all the same.
        """
        return {}


@dataclass(frozen=True)
class FullView(View):
    """All state components."""

    name: str = "full"

    def expected(self, state: ca.SX, dynamics: Components) -> ca.SX:
        return state

    def component_names(self, dynamics: Components) -> tuple[str, ...]:
        return dynamics.state_names

    def bounds(
        self, low: np.ndarray, high: np.ndarray, dynamics: Components
    ) -> tuple[np.ndarray, np.ndarray]:
        return low, high

    def noise_scale(self, scale: np.ndarray, dynamics: Components) -> np.ndarray:
        return scale

    def read_off(self, y: np.ndarray, dynamics: Components) -> dict[str, np.ndarray]:
        return {name: y[..., k] for k, name in enumerate(dynamics.state_names)}


@dataclass(frozen=True)
class ComponentView(View):
    """The named state components, in that order.

    Raises:
        ValueError: at its first use, on a component that the state does not have.
    """

    name: str
    components: tuple[str, ...]

    def expected(self, state: ca.SX, dynamics: Components) -> ca.SX:
        return ca.vertcat(*[state[k] for k in _columns(self, self.components, dynamics)])

    def component_names(self, dynamics: Components) -> tuple[str, ...]:
        return self.components

    def bounds(
        self, low: np.ndarray, high: np.ndarray, dynamics: Components
    ) -> tuple[np.ndarray, np.ndarray]:
        columns = _columns(self, self.components, dynamics)
        return low[columns], high[columns]

    def noise_scale(self, scale: np.ndarray, dynamics: Components) -> np.ndarray:
        return scale[_columns(self, self.components, dynamics)]

    def read_off(self, y: np.ndarray, dynamics: Components) -> dict[str, np.ndarray]:
        return {name: y[..., k] for k, name in enumerate(self.components)}


@dataclass(frozen=True)
class RangeBearingView(View):
    """Range [m] and bearing [rad] from a sensor at a fixed place, as a roadside LiDAR reports.

    The bearing is counter-clockwise from the direction that the sensor faces and within
    [-pi, pi]: it jumps where a player passes behind the sensor, so let it face the scene. A
    player at the very place of the sensor has no bearing that could be differentiated.

    Attributes:
        position: of the sensor, px and py [m].
        facing: direction of bearing zero [rad], counter-clockwise from the x axis.
    """

    position: tuple[float, float] = (0.0, 0.0)
    facing: float = 0.0
    name: str = "range_bearing"

    def expected(self, state: ca.SX, dynamics: Components) -> ca.SX:
        px, py = (state[k] for k in _columns(self, ("px", "py"), dynamics))
        ahead, left = self._turn(px - self.position[0], py - self.position[1], -self.facing)
        return ca.vertcat(ca.sqrt(ahead**2 + left**2), ca.atan2(left, ahead))

    def component_names(self, dynamics: Components) -> tuple[str, ...]:
        return ("range", "bearing")

    def bounds(
        self, low: np.ndarray, high: np.ndarray, dynamics: Components
    ) -> tuple[np.ndarray, np.ndarray]:
        columns = _columns(self, ("px", "py"), dynamics)
        farthest = np.abs(np.stack([low[columns], high[columns]]) - self.position).max(axis=0)
        return np.array([0.0, -np.pi]), np.array([np.linalg.norm(farthest), np.pi])

    def read_off(self, y: np.ndarray, dynamics: Components) -> dict[str, np.ndarray]:
        distance, direction = y[..., 0], y[..., 1] + self.facing
        return {
            "px": self.position[0] + distance * np.cos(direction),
            "py": self.position[1] + distance * np.sin(direction),
        }

    @staticmethod
    def _turn(x: ca.SX, y: ca.SX, angle: float) -> tuple[ca.SX, ca.SX]:
        cos, sin = float(np.cos(angle)), float(np.sin(angle))
        return cos * x - sin * y, sin * x + cos * y


def _columns(view: View, components: tuple[str, ...], dynamics: Components) -> list[int]:
    """Where a state has these components.

    Raises:
        ValueError: if it lacks one.
    """
    for component in components:
        if component not in dynamics.state_names:
            raise ValueError(
                f"view {view.name!r}: no component {component!r} here; "
                f"there are: {', '.join(dynamics.state_names)}"
            )
    return [dynamics.state_names.index(component) for component in components]


#: The paper's two views, by name.
VIEWS: dict[str, View] = {
    view.name: view for view in (FullView(), ComponentView("partial", ("px", "py", "heading")))
}


def observation_size(view: View, dynamics: Components) -> int:
    """d, the number of observed components per player."""
    return view.expected(ca.SX.sym("state", dynamics.state_size), dynamics).numel()


def observe(view: View, dynamics: Components, states: np.ndarray) -> np.ndarray:
    """Noise-free observations (..., d) of states (..., n)."""
    states = np.asarray(states, dtype=float)
    flat = states.reshape(-1, dynamics.state_size)
    observed = np.array(observation_function(view, dynamics)(flat.T)).T
    return observed.reshape(*states.shape[:-1], -1)


@lru_cache(maxsize=64)
def observation_function(view: View, dynamics: Components) -> ca.Function:
    """H as a function of states (n, S) in columns, any number of them."""
    state = ca.SX.sym("state", dynamics.state_size)
    return ca.Function("h", [state], [ca.densify(view.expected(state, dynamics))])

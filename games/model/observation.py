"""Observation models h (eqn. awgn_observation): what a sensor is expected to see of one state.

A view is data plus one CasADi expression, so estimators differentiate the same function that
generates the observations; noise is not part of it (``games.model.sensor``). Angles are not
wrapped, neither in y = h(x) + noise nor in y - h(x): a heading continues beyond pi, and a bearing
jumps behind the sensor, so sensors must face the scene.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import casadi as ca
import numpy as np

#: Least eigenvalue of a covariance, relative to its largest.
_SINGULAR = 1e-12


class Components(Hashable, Protocol):
    """Anything that names the components of a state: a motion model, or a sensor's report."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the n components."""

    @property
    def state_size(self) -> int:
        """Number of components, n."""


class View(ABC):
    """An observation model, applied to each player's state separately, and its short name.

    Views are frozen dataclasses: solvers are built once per structure of a view and found again by
    its hash; its numbers are data (``games.model.numbers``).
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
        """Standard deviations (d,) of noise over sigma, from those of state components (n,)."""
        return np.ones(observation_size(self, dynamics))

    def read_off(self, y: np.ndarray, dynamics: Components) -> dict[str, np.ndarray]:
        """State components (...) that observations (..., d) determine, by name: starts."""
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

    Raises ValueError unless they are different names; at its first use, on one that the state does
    not have.
    """

    name: str
    components: tuple[str, ...]

    def __post_init__(self) -> None:
        given = self.components
        is_list = isinstance(given, list | tuple) and all(isinstance(one, str) for one in given)
        if not (is_list and given and len(set(given)) == len(given)):
            raise ValueError(f"components must be a list of different names, got {given!r}")
        object.__setattr__(self, "components", tuple(given))

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

    The bearing is measured counter-clockwise from the direction that the sensor faces, within [-pi,
    pi]. It jumps when a player passes behind the sensor, so the sensor should face the scene. It is
    not differentiable at the sensor's position.

    Noise on the range has the scale of noise on a position. Noise on the bearing has another scale:
    at the default of 0.1 rad/m, a sigma of 0.1 m comes with 0.01 rad, which is 1 m across the line
    of sight at a distance of 100 m. Raises ValueError on numbers that are not finite, or a
    bearing_scale that is not positive.

    Attributes:
        position: position of the sensor, px and py [m].
        facing: direction of bearing zero [rad], counter-clockwise from the x axis.
        bearing_scale: standard deviation of the bearing over that of the range [rad/m].
    """

    position: tuple[float, float] = (0.0, 0.0)
    facing: float = 0.0
    bearing_scale: float = 0.1
    name: str = "range_bearing"

    def __post_init__(self) -> None:
        try:
            px, py, facing = (float(value) for value in (*self.position, self.facing))
        except (TypeError, ValueError):
            px = py = facing = np.nan
        if not np.isfinite([px, py, facing]).all():
            raise ValueError(
                f"position must be px and py, got {self.position!r}, and facing a number, got "
                f"{self.facing!r}"
            )
        object.__setattr__(self, "position", (px, py))
        object.__setattr__(self, "facing", facing)
        if not (np.isfinite(self.bearing_scale) and self.bearing_scale > 0):
            raise ValueError(f"bearing_scale must be above 0 rad/m, got {self.bearing_scale}")

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

    def noise_scale(self, scale: np.ndarray, dynamics: Components) -> np.ndarray:
        position = scale[_columns(self, ("px", "py"), dynamics)].max()
        return np.array([position, position * self.bearing_scale])

    def read_off(self, y: np.ndarray, dynamics: Components) -> dict[str, np.ndarray]:
        distance, direction = y[..., 0], y[..., 1] + self.facing
        return {
            "px": self.position[0] + distance * np.cos(direction),
            "py": self.position[1] + distance * np.sin(direction),
        }

    @staticmethod
    def _turn(x: ca.SX, y: ca.SX, angle: ca.SX | float) -> tuple[ca.SX, ca.SX]:
        cos, sin = ca.cos(angle), ca.sin(angle)
        return cos * x - sin * y, sin * x + cos * y


@dataclass(frozen=True)
class StackedView(View):
    """Views in turn, the lowest first; ValueError at first use if a component is gone."""

    views: tuple[View, ...]

    @property
    def name(self) -> str:  # type: ignore[override]
        return "+".join(view.name for view in self.views)

    def expected(self, state: ca.SX, dynamics: Components) -> ca.SX:
        for view, below in self._levels(dynamics):
            state = view.expected(state, below)
        return state

    def component_names(self, dynamics: Components) -> tuple[str, ...]:
        view, below = self._levels(dynamics)[-1]
        return view.component_names(below)

    def bounds(
        self, low: np.ndarray, high: np.ndarray, dynamics: Components
    ) -> tuple[np.ndarray, np.ndarray]:
        for view, below in self._levels(dynamics):
            low, high = view.bounds(low, high, below)
        return low, high

    def noise_scale(self, scale: np.ndarray, dynamics: Components) -> np.ndarray:
        for view, below in self._levels(dynamics):
            scale = view.noise_scale(scale, below)
        return scale

    def read_off(self, y: np.ndarray, dynamics: Components) -> dict[str, np.ndarray]:
        # Components that a view hides are NaN on the way down; those that stay NaN are unknown.
        levels = self._levels(dynamics)
        known = _down(levels, np.zeros(observation_size(self, dynamics)))
        found = _down(levels, y)
        return {name: values for name, values in found.items() if np.isfinite(known[name])}

    def _levels(self, dynamics: Components) -> list[tuple[View, Components]]:
        """Each view with the components of its input."""
        levels: list[tuple[View, Components]] = []
        below = dynamics
        for view in self.views:
            levels.append((view, below))
            below = NamedComponents(view.component_names(below))
        return levels


def _down(levels: list[tuple[View, Components]], y: np.ndarray) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    for view, below in reversed(levels):
        found = view.read_off(y, below)
        unknown = np.full(y.shape[:-1], np.nan)
        y = np.stack([found.get(name, unknown) for name in below.state_names], axis=-1)
    return found


@dataclass(frozen=True)
class NamedComponents:
    """Named components: the output of one view and the input of the next."""

    state_names: tuple[str, ...]

    @property
    def state_size(self) -> int:
        return len(self.state_names)


@dataclass(frozen=True)
class WhitenedView(View):
    """A view in coordinates W h(x) in which its noise is independent and of unit scale.

    Attributes:
        view: h.
        matrix: (d, d) W, from ``whitening``.
    """

    view: View
    matrix: tuple[tuple[float, ...], ...]

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.view.name

    def expected(self, state: ca.SX, dynamics: Components) -> ca.SX:
        rows = [ca.horzcat(*row) for row in self.matrix]
        return ca.mtimes(ca.vertcat(*rows), self.view.expected(state, dynamics))

    def read_off(self, y: np.ndarray, dynamics: Components) -> dict[str, np.ndarray]:
        return self.view.read_off(y @ np.linalg.inv(self.matrix).T, dynamics)


def whitening(covariance: np.ndarray | Sequence[Sequence[float]]) -> np.ndarray:
    """W (d, d), lower triangular, that whitens noise; ValueError on what is no covariance."""
    covariance = np.asarray(covariance, dtype=float)
    if covariance.ndim != 2 or covariance.shape[0] != covariance.shape[1]:
        raise ValueError(f"a covariance is a square matrix, got the shape {covariance.shape}")
    if not np.isfinite(covariance).all() or not np.allclose(covariance, covariance.T):
        raise ValueError(f"a covariance is finite and symmetric, got {covariance.tolist()}")
    values = np.linalg.eigvalsh(covariance)
    if not values[0] > _SINGULAR * values[-1]:
        raise ValueError(
            f"a covariance is positive definite, this one has the eigenvalue {values[0]:.3g}: "
            f"{covariance.tolist()}"
        )
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def stacked(views: Sequence[View]) -> View:
    """One view for several applied in turn; the full view if there are none."""
    seeing = [view for view in views if not isinstance(view, FullView)]
    if not seeing:
        return FullView()
    return seeing[0] if len(seeing) == 1 else StackedView(tuple(seeing))


def _columns(view: View, components: tuple[str, ...], dynamics: Components) -> list[int]:
    """Indices of these components in a state; ValueError if it lacks one."""
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
    return int(observation_function(view, dynamics).numel_out(0))


def observe(view: View, dynamics: Components, states: np.ndarray) -> np.ndarray:
    """Noise-free observations (..., d) of states (..., n)."""
    states = np.asarray(states, dtype=float)
    flat = states.reshape(-1, dynamics.state_size)
    observed = np.array(observation_function(view, dynamics)(flat.T)).T
    return observed.reshape(*states.shape[:-1], -1)


@lru_cache(maxsize=64)
def observation_function(view: View, dynamics: Components) -> ca.Function:
    """The function h of states (n, S), one per column, for any S."""
    state = ca.SX.sym("state", dynamics.state_size)
    return ca.Function("h", [state], [ca.densify(view.expected(state, dynamics))])

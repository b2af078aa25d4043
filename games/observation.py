"""Observation models h (eqn. awgn_observation): what a sensor is expected to see of one state.

A view is data plus one CasADi expression, so estimators differentiate the very function that
generates the observations. The noise that sensors add is not part of it.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from games.dynamics import Dynamics


class View(ABC):
    """An observation model, applied to each player's state on its own.

    Views are frozen dataclasses: solvers are built once per view and found again by its hash.

    Attributes:
        name: short name, used in suites and tables.
    """

    name: str

    @abstractmethod
    def expected(self, state: ca.SX, dynamics: Dynamics) -> ca.SX:
        """h(x): expected observation (d,) of one player's state (n,)."""


@dataclass(frozen=True)
class FullView(View):
    """All state components."""

    name: str = "full"

    def expected(self, state: ca.SX, dynamics: Dynamics) -> ca.SX:
        return state


@dataclass(frozen=True)
class ComponentView(View):
    """The named state components, in that order."""

    name: str
    components: tuple[str, ...]

    def expected(self, state: ca.SX, dynamics: Dynamics) -> ca.SX:
        return ca.vertcat(*[state[dynamics.state_names.index(c)] for c in self.components])


#: The paper's two views, by name.
VIEWS: dict[str, View] = {
    view.name: view for view in (FullView(), ComponentView("partial", ("px", "py", "heading")))
}


def observation_size(view: View, dynamics: Dynamics) -> int:
    """d, the number of observed components per player."""
    return view.expected(ca.SX.sym("state", dynamics.state_size), dynamics).numel()


def observe(view: View, dynamics: Dynamics, states: np.ndarray) -> np.ndarray:
    """Noise-free observations (..., d) of states (..., n)."""
    states = np.asarray(states, dtype=float)
    flat = states.reshape(-1, dynamics.state_size)
    observed = np.array(_observe_function(view, dynamics)(flat.T)).T
    return observed.reshape(*states.shape[:-1], -1)


@lru_cache(maxsize=64)
def _observe_function(view: View, dynamics: Dynamics) -> ca.Function:
    state = ca.SX.sym("state", dynamics.state_size)
    return ca.Function("h", [state], [view.expected(state, dynamics)])

"""Discrete-time motion of one player, as data that the game builders read.

A model is a name, the names of its state and control components, and one CasADi expression
``step(state, control, dt) -> next state``. Every model starts its state with the position
``px [m], py [m]``, so that features and metrics of positions work with all of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Dynamics:
    """A motion model shared by all players of a game.

    Attributes:
        name: short name, used in messages.
        state_names: names of the n state components; the first two are ``px`` and ``py`` [m].
        control_names: names of the m control components.
        step: ``(state (n,), control (m,), dt [s]) -> next state (n,)`` on CasADi symbols.
    """

    name: str
    state_names: tuple[str, ...]
    control_names: tuple[str, ...]
    step: Callable[[ca.SX, ca.SX, ca.SX | float], ca.SX]

    @property
    def state_size(self) -> int:
        """n, the number of state components of one player."""
        return len(self.state_names)

    @property
    def control_size(self) -> int:
        """m, the number of control components of one player."""
        return len(self.control_names)


def _unicycle_step(state: ca.SX, control: ca.SX, dt: ca.SX | float) -> ca.SX:
    px, py, heading, speed = ca.vertsplit(state)
    yaw_rate, acceleration = ca.vertsplit(control)
    return ca.vertcat(
        px + dt * speed * ca.cos(heading),
        py + dt * speed * ca.sin(heading),
        heading + dt * yaw_rate,
        speed + dt * acceleration,
    )


def _double_integrator_step(state: ca.SX, control: ca.SX, dt: ca.SX | float) -> ca.SX:
    position, velocity = state[:2], state[2:]
    return ca.vertcat(position + dt * velocity, velocity + dt * control)


#: Unicycle of Peters et al. 2021, eqn. runexp-dynamics.
#: State px [m], py [m], heading [rad], speed [m/s]; control yaw_rate [rad/s], acceleration [m/s^2].
UNICYCLE = Dynamics(
    name="unicycle",
    state_names=("px", "py", "heading", "speed"),
    control_names=("yaw_rate", "acceleration"),
    step=_unicycle_step,
)

#: Planar double integrator, explicit Euler; linear, for games with an analytic solution.
#: State px [m], py [m], vx [m/s], vy [m/s]; control ax [m/s^2], ay [m/s^2].
DOUBLE_INTEGRATOR = Dynamics(
    name="double_integrator",
    state_names=("px", "py", "vx", "vy"),
    control_names=("ax", "ay"),
    step=_double_integrator_step,
)


@dataclass(frozen=True)
class _BicycleStep:
    """The step of ``bicycle``: not a closure, so that games can be compared and pickled."""

    rear_axle: float
    sub_steps: int

    def __call__(self, state: ca.SX, control: ca.SX, dt: ca.SX | float) -> ca.SX:
        px, py, heading, speed = ca.vertsplit(state)
        steering, acceleration = ca.vertsplit(control)
        slip = ca.atan(ca.tan(steering) / 2)
        h = dt / self.sub_steps
        for _ in range(self.sub_steps):
            px, py, heading, speed = (
                px + speed * ca.cos(heading + slip) * h,
                py + speed * ca.sin(heading + slip) * h,
                heading + speed * ca.sin(slip) / self.rear_axle * h,
                speed + acceleration * h,
            )
        return ca.vertcat(px, py, heading, speed)


@lru_cache(maxsize=64)
def bicycle(rear_axle: float = 2.5, sub_steps: int = 1) -> Dynamics:
    """Kinematic bicycle, in ``sub_steps`` equal explicit Euler steps under a constant control.

    It is the same map as HighwayEnv's ``Vehicle.step`` (Leurent 2018), whose simulation runs so
    many frames per action. State px [m], py [m], heading [rad], speed [m/s]; control steering
    [rad], acceleration [m/s^2]. The rear axle is so far [m] from the centre of gravity, in the
    middle. Raises ValueError if a parameter is out of range.
    """
    if sub_steps < 1:
        raise ValueError(f"sub_steps must be at least 1, got {sub_steps}")
    if not rear_axle > 0:
        raise ValueError(f"rear_axle must be a positive number of metres, got {rear_axle}")
    return Dynamics(
        name="bicycle",
        state_names=("px", "py", "heading", "speed"),
        control_names=("steering", "acceleration"),
        step=_BicycleStep(rear_axle, sub_steps),
    )


@dataclass(frozen=True)
class _ClockStep:
    """The step of ``with_clock``."""

    moved: Callable[[ca.SX, ca.SX, ca.SX | float], ca.SX]

    def __call__(self, state: ca.SX, control: ca.SX, dt: ca.SX | float) -> ca.SX:
        return ca.vertcat(self.moved(state[:-1], control, dt), state[-1] + dt)


def with_clock(dynamics: Dynamics) -> Dynamics:
    """The model with the time as a last state ``clock`` [s], for features that depend on it.

    Where initial states are estimated, the clock is told with a small ``noise_scale``.
    """
    names = (*dynamics.state_names, "clock")
    name = f"{dynamics.name} with clock"
    return Dynamics(name, names, dynamics.control_names, _ClockStep(dynamics.step))


@dataclass(frozen=True)
class _JerkStep:
    """The step of ``with_jerk``; ``place`` is that of the acceleration among the controls."""

    moved: Callable[[ca.SX, ca.SX, ca.SX | float], ca.SX]
    place: int

    def __call__(self, state: ca.SX, control: ca.SX, dt: ca.SX | float) -> ca.SX:
        jerk, known = control[self.place], ca.SX(control)
        known[self.place] = state[-1]
        return ca.vertcat(self.moved(state[:-1], known, dt), state[-1] + dt * jerk)


def with_jerk(dynamics: Dynamics) -> Dynamics:
    """The model with ``acceleration`` as a last state and ``jerk`` [m/s^3] as the control of it.

    ``ControlEffort("jerk")`` then is a cost of motion that is not smooth, and
    ``StateDeviation("acceleration")`` one of hard braking. Raises ValueError on a model without
    an acceleration among its controls.
    """
    if "acceleration" not in dynamics.control_names:
        raise ValueError(
            f"{dynamics.name} has no control 'acceleration' but {', '.join(dynamics.control_names)}"
        )
    place = dynamics.control_names.index("acceleration")
    names = tuple("jerk" if name == "acceleration" else name for name in dynamics.control_names)
    step = _JerkStep(dynamics.step, place)
    states = (*dynamics.state_names, "acceleration")
    return Dynamics(f"{dynamics.name} with jerk", states, names, step)


def dynamics_errors(
    dynamics: Dynamics, states: Sequence[ca.SX], controls: Sequence[ca.SX], dt: ca.SX | float
) -> list[ca.SX]:
    """F_t = x_{t+1} - f(x_t, u_t) of one player, from T states (n,) and T-1 controls (m,)."""
    return [
        following - dynamics.step(state, control, dt)
        for state, control, following in zip(states[:-1], controls, states[1:], strict=True)
    ]


def rollout(
    dynamics: Dynamics, initial_state: np.ndarray, controls: np.ndarray, dt: float
) -> np.ndarray:
    """States (T, N, n) under open-loop controls (T-1, N, m), with steps dt [s], from (N, n)."""
    first, controls = np.asarray(initial_state, dtype=float), np.asarray(controls, dtype=float)
    steps, players, size = controls.shape
    if steps == 0:
        return first[None]
    columns = controls.reshape(-1, size).T
    later = np.array(_steps(dynamics, dt, players, steps)(first.T, columns))
    return np.concatenate([first[None], later.T.reshape(steps, *first.shape)])


@lru_cache(maxsize=16)
def numeric_step(dynamics: Dynamics, dt: float) -> ca.Function:
    """The map of one step, ``(state (n, N), control (m, N)) -> next state (n, N)``, for any N.

    All numerical simulation uses it, so that replays agree to the last bit.
    """
    state = ca.SX.sym("state", dynamics.state_size)
    control = ca.SX.sym("control", dynamics.control_size)
    return ca.Function("step", [state, control], [dynamics.step(state, control, dt)])


@lru_cache(maxsize=64)
def _steps(dynamics: Dynamics, dt: float, players: int, steps: int) -> ca.Function:
    """``(state (n, N), controls (m, N steps)) -> states (n, N steps)``, one step after another."""
    return numeric_step(dynamics, dt).map(players).mapaccum(steps)

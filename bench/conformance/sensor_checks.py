"""Rules of sensors, as checks."""

from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from olne_bench.bench.conformance import NonConformance
from olne_bench.bench.judge.observe import observe, sensor_model
from olne_bench.envs.recordings.recording import Recording, record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.observation import View, observation_function
from olne_bench.games.model.sensor import SensorModel

#: Relative tolerance between derivatives and finite differences, and the step of the latter.
_DERIVATIVE_TOLERANCE, _STEP = 1e-5, 1e-6


def _layers(plugin: Any) -> None:
    """Its layers are plain data that fit each other and a state, the same at every call."""
    layers = _stack(plugin)
    if layers != _stack(plugin) or hash(layers) != hash(_stack(plugin)):
        raise NonConformance("layers() gives other layers at every call: make them of plain data")
    _model(plugin)


def _differentiable(plugin: Any) -> None:
    """The function h and its derivative are finite, and finite differences confirm the latter."""
    view, dynamics = _model(plugin).view, _recording().scenario.game.dynamics
    state = ca.SX.sym("state", dynamics.state_size)
    slope = ca.Function("slope", [state], [ca.jacobian(view.expected(state, dynamics), state)])
    for point in _recording().states[::6].reshape(-1, dynamics.state_size):
        derivative = np.array(slope(point))
        if not (np.isfinite(derivative).all() and np.isfinite(_expected(view, point)).all()):
            raise NonConformance(f"h or its derivative is not finite at the state {point.tolist()}")
        steps = _STEP * np.eye(len(point))
        differences = [_expected(view, point + s) - _expected(view, point - s) for s in steps]
        numeric = np.column_stack(differences) / (2 * _STEP)
        size = max(1.0, np.abs(derivative).max())
        if np.abs(numeric - derivative).max() > _DERIVATIVE_TOLERANCE * size:
            raise NonConformance(
                f"the derivative of h jumps at the state {point.tolist()}: it is "
                f"{derivative.tolist()}, finite differences are {numeric.tolist()}"
            )


def _gaps(plugin: Any) -> None:
    """Samples are finite, or NaN for all components of a player if the sensor has a gaps layer."""
    missed = False
    for seed in range(5):
        (seen,) = observe([_recording()], _stack(plugin), 0.01, seed)
        gaps = np.isnan(seen.y)
        if np.isinf(seen.y).any():
            raise NonConformance("it shows infinity: a missing sample is NaN")
        if (gaps.any(axis=-1) != gaps.all(axis=-1)).any():
            raise NonConformance("parts of a player's sample are missing: gaps are whole blocks")
        if gaps.all():
            raise NonConformance("it shows nothing at all")
        missed = missed or bool(gaps.any())
    if missed and not _model(plugin).may_miss:
        raise NonConformance("samples are missing without a gaps layer")


def _determinism(plugin: Any) -> None:
    """The seed is its only source of randomness."""
    (first,) = observe([_recording()], _stack(plugin), 0.01, 0)
    np.random.seed(1)  # noqa: NPY002 (a sensor that uses it must not get away with it)
    (second,) = observe([_recording()], _stack(plugin), 0.01, 0)
    if not np.array_equal(first.y, second.y, equal_nan=True):
        raise NonConformance("two observations of one seed differ")


@cache
def _recording() -> Recording:
    return record(get_scenario("two_player"))


def _stack(plugin: Any) -> tuple[Any, ...]:
    layers = plugin.layers()
    if not isinstance(layers, tuple):
        raise NonConformance(f"layers() returned a {type(layers).__name__}, expected a tuple")
    return layers


def _model(plugin: Any) -> SensorModel:
    try:
        return sensor_model(_recording().scenario, _stack(plugin))
    except ValueError as error:
        raise NonConformance(f"its layers make no sensor for 'two_player': {error}") from error


def _expected(view: View, state: np.ndarray) -> np.ndarray:
    dynamics = _recording().scenario.game.dynamics
    return np.array(observation_function(view, dynamics)(state)).ravel()


#: Checks by name, in the order in which they run.
CHECKS: dict[str, Callable[[Any], None]] = {
    "layers make a sensor": _layers,
    "finite and differentiable": _differentiable,
    "gaps are NaN": _gaps,
    "determinism under a fixed seed": _determinism,
}

"""Observations of recordings: a recording is played again and seen through sensors.

``envs.worlds.wrappers`` are put around a world that plays the recording, so an observation equals
what the wrapped world showed, bit for bit.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Generic, TypeVar

import numpy as np

from olne_bench import plugins
from olne_bench.bench.plan.entries import SensorEntry
from olne_bench.envs.recordings.recording import Recording
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.worlds.recorded import RecordedWorld
from olne_bench.envs.worlds.wrappers import World, wrap
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import FullView, View, observation_function
from olne_bench.games.model.sensor import Layer, SensorModel
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

T = TypeVar("T")


def layers_of(sensor: SensorEntry) -> tuple[Layer, ...]:
    """The layers of a sensor, the innermost first; ``PluginError`` if one cannot be made."""
    made = [plugins.make(plugins.SENSOR, entry.name, entry.parameters) for entry in sensor.layers]
    return tuple(layer for one in made for layer in _layers(one))


def _layers(sensor: Any) -> tuple[Layer, ...]:
    with plugins.at_home(sensor):
        return tuple(sensor.layers())


def sensor_model(scenario: Scenario, layers: Sequence[Layer]) -> SensorModel:
    """What an estimator may know of a sensor in a scenario; ValueError if layers do not fit."""
    return SensorModel.of(layers, scenario.game.dynamics, scenario.noise_scale)


def problem_of(told: Game, model: SensorModel, sigma: float, prior: WeightPrior = FLAT) -> Problem:
    """What an estimator is told of a game that is seen through a sensor, with noise ``sigma``."""
    return Problem(
        told,
        model.view,
        sigma,
        noise_scale=model.noise_scale,
        noise_covariance=model.noise_covariance,
        prior=prior,
    )


def observe(
    recordings: Sequence[Recording], layers: Sequence[Layer], sigma: float, seed: int
) -> tuple[Observation, ...]:
    """Observe recordings through a sensor.

    The noise of a component depends on its name and the seed only, so sensors that show the same
    component show the same noise on it.

    Args:
        recordings: the true motions.
        layers: layers of the sensor.
        sigma: noise level [m], which scales the drawn noise.
        seed: of noise and gaps, at least 0; recordings after the first use seeds drawn from it.

    Raises:
        ValueError: as ``sensor_model``, or if a bearing jumps.
    """
    shown = []
    for k, recording in enumerate(recordings):
        world = _wrapped(Same(recording), tuple(layers), sigma)
        frames = _frames(world, seed if k == 0 else _seed(seed, k))
        frames = _as_departed(frames, recording, layers, sigma)
        shown.append(Observation(y=frames[:-1], extra=frames[-1]))
    return tuple(shown)


def observe_states(
    world: RecordedWorld, noise_scale: Sequence[float], sigma: float, seed: int
) -> np.ndarray:
    """Whole states (S, N, n) of a world's S steps under the noise that ``observe`` adds.

    ``noise_scale`` (n,) is relative to sigma [m]; the seed is that of the first recording's noise.
    """
    return _frames(wrap(world, (FullView(),), sigma, noise_scale), seed)


def _seed(seed: int, index: int) -> int:
    return int(np.random.default_rng([seed, index]).integers(2**63))


class Same(Generic[T]):
    """An object that is compared by identity, because arrays have no hash."""

    def __init__(self, it: T) -> None:
        self.it = it

    def __hash__(self) -> int:
        return id(self.it)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other.it is self.it


@lru_cache(maxsize=64)
def _wrapped(same: Same[Recording], layers: tuple[Layer, ...], sigma: float) -> World:
    scenario = same.it.scenario
    model = sensor_model(scenario, layers)
    _check_angles(model.view, same.it)
    return wrap(same.it.world(), layers, sigma, scenario.noise_scale)


def _check_angles(view: View, recording: Recording) -> None:
    """Refuse a sensor if a player passes behind it; the error names player and step."""
    dynamics = recording.scenario.game.dynamics
    names = view.component_names(dynamics)
    seen = observed(view, recording)
    for k in [k for k, name in enumerate(names) if name == "bearing"]:
        jumps = np.abs(np.diff(seen[..., k], axis=0)) > np.pi
        if jumps.any():
            step, player = np.argwhere(jumps)[0]
            raise ValueError(
                f"sensor {view.name!r}: player {player} of {recording.scenario.name!r} passes "
                f"behind it between steps {step} and {step + 1}, where the bearing jumps; let it "
                "face the scene"
            )


def _as_departed(
    frames: np.ndarray, recording: Recording, layers: Sequence[Layer], sigma: float
) -> np.ndarray:
    """Samples (S, N, d) with the errors of a world that departs from what estimators are told."""
    departure = recording.scenario.departure
    if departure is None:
        return frames
    model = sensor_model(recording.scenario, layers)
    clean = observed(model.view, recording)
    deviations = sigma * np.asarray(model.noise_scale)
    return np.asarray(clean + departure.disturbed(frames - clean, clean, deviations))


def _frames(world: World, seed: int) -> np.ndarray:
    """What is seen (S, N, d) in one pass of a recorded world."""
    shown, _ = world.reset(seed=seed)
    frames = list(shown.values())
    while world.agents:
        shown, *_ = world.step({})
        frames += shown.values()
    layout = world.observation_layout
    return np.array(frames)[:, :-1].reshape(len(frames), layout.num_players, layout.state_size)


def observed(view: View, recording: Recording) -> np.ndarray:
    """h(x) (T+1, N, d) of a recording and its extra state, without noise."""
    states = recording.all_states
    dynamics = recording.scenario.game.dynamics
    flat = np.array(observation_function(view, dynamics)(states.reshape(-1, states.shape[-1]).T)).T
    return flat.reshape(*states.shape[:2], -1)

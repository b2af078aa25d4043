"""Sensors: PettingZoo wrappers that add noise, partial views and gaps to observations.

They change observations only, not traffic, rewards and ``state()``. Each random wrapper has one
stream per player, seeded from the seed of ``reset`` and a key of its class, so neither traffic nor
other sensors depend on it. Noise has one stream per name of a component: two sensors that both show
``px`` show the same noise on it.

Wrappers can be stacked in any order in which each finds the components it needs, around any world
with an ``observation_layout`` (``envs.worlds.layout``); those of other libraries below a sensor
must keep the shape of the observations::

    world = AWGN(PartialObservation(olne_v0.parallel_env(), ("px", "py", "heading")), sigma=0.02)
"""

import zlib
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, ClassVar, TypeAlias

import numpy as np
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from olne_bench.envs.worlds.layout import ObservationLayout, Start, Step, player_index
from olne_bench.games.compiled.buffered import BufferedFunction
from olne_bench.games.model.observation import (
    ComponentView,
    FullView,
    RangeBearingView,
    View,
    observation_function,
)
from olne_bench.games.model.sensor import Drops, GapsLayer, Layer, SensorModel, Stack

World: TypeAlias = ParallelEnv[str, np.ndarray, np.ndarray]

#: Spaces of noisy observations are widened by this many standard deviations. A Gaussian has no
#: bounds, but a draw beyond these has the probability 1.5e-23.
_NOISE_REACH = 10.0

#: Number of steps for which noise is drawn at once; the noise does not depend on it.
_STEPS_AHEAD = 32


def wrap(
    world: World, layers: Sequence[Layer], sigma: float, noise_scale: Sequence[float] | np.ndarray
) -> World:
    """Put the layers of a sensor around a world: views, noise, gaps, in the order of likelihoods.

    Args:
        world: the world.
        layers: layers of the sensor (``games.model.sensor``).
        sigma: noise level [m], at least 0.
        noise_scale: (n,) the scenario's standard deviations, relative to sigma.

    Raises:
        ValueError: on layers that do not fit each other or the world, or a sigma out of range.
    """
    if not (np.isfinite(sigma) and sigma >= 0):
        raise ValueError(f"sigma must be finite and non-negative, got {sigma}")
    stack, model = Stack.of(layers), SensorModel.of(layers, _layout_of(world), noise_scale)
    if not isinstance(stack.view, FullView):
        world = ObservationView(world, stack.view)
    if sigma > 0 and model.noise_covariance is None:
        world = AWGN(world, sigma * np.array(model.noise_scale))
    elif sigma > 0:
        world = AWGN(world, covariance=sigma**2 * np.array(model.covariance))
    for gaps in stack.gaps:
        world = Gaps(world, gaps)
    return world


class BoxWithGaps(Box):
    """A box that also contains vectors with missing entries (NaN)."""

    def contains(self, x: Any) -> bool:
        if isinstance(x, np.ndarray) and x.shape == self.shape:
            x = np.where(np.isnan(x), self.low, x)
        return super().contains(x)


class _Observing(BaseParallelWrapper[str, np.ndarray, np.ndarray]):
    """A wrapper that changes observations; spaces are the same objects while those below are."""

    def __init__(self, env: World) -> None:
        super().__init__(env)
        self._known_spaces: dict[Any, tuple[Box, Box]] = {}

    def observation_space(self, agent: str) -> Box:
        return self._known(agent, self.env.observation_space(agent), self._space)

    def _known(self, key: Any, below: Box, make: Callable[[Box], Box]) -> Box:
        known = self._known_spaces.get(key)
        if known is None or known[0] is not below:
            known = self._known_spaces[key] = (below, make(below))
        return known[1]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Start:
        observations, infos = self.env.reset(seed=seed, options=options)
        self._check_layout()
        return self._observe_all(observations), infos

    def step(self, actions: dict[str, np.ndarray]) -> Step:
        observations, *rest = self.env.step(actions)
        return self._observe_all(observations), *rest

    def _check_layout(self) -> None:
        """Find the layout below, which a reset may change."""

    @abstractmethod
    def _space(self, below: Box) -> Box:
        """The space above from the space below."""

    @abstractmethod
    def _observe_all(self, observations: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The observations above from those below."""


class _Sensor(_Observing):
    """A wrapper that changes the blocks of observations and keeps the time at their end."""

    def __init__(self, env: World) -> None:
        super().__init__(env)
        self._known_layout: ObservationLayout | None = None
        self._check_layout()
        for player in env.possible_agents:  # a sensor that does not fit fails at once
            self.observation_space(player)

    @property
    def observation_layout(self) -> ObservationLayout:
        """Layout of the observations above this wrapper."""
        return self._layout_below

    def _prepare(self) -> None:
        """Prepare for a new layout below."""

    @abstractmethod
    def _bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bounds (N, d') above from bounds (N, d) below."""

    @abstractmethod
    def _observe(self, player: str, below: np.ndarray) -> np.ndarray:
        """An observation (N d' + 1,) above from one (N d + 1,) below, which stays as it is."""

    def _space(self, below: Box) -> Box:
        layout = self._layout_below
        low, high = self._bounds(layout.blocks(below.low), layout.blocks(below.high))
        return type(below)(
            np.append(low, below.low[-1]).astype(below.dtype),
            np.append(high, below.high[-1]).astype(below.dtype),
            dtype=below.dtype,
        )

    def _observe_all(self, observations: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {player: self._observe(player, below) for player, below in observations.items()}

    def _check_layout(self) -> None:
        layout = _layout_of(self.env)
        if layout != self._known_layout:
            self._layout_below = layout
            self._prepare()
            self._known_layout = layout
        for player in self.env.possible_agents:
            shape = self.env.observation_space(player).shape
            if shape != (self._layout_below.size,):
                raise ValueError(
                    f"{type(self).__name__} needs observations of the shape "
                    f"{(self._layout_below.size,)}, the wrappers below give {shape}: put "
                    "wrappers that change the shape above it"
                )


class ObservationView(_Sensor):
    """Each player sees all through an observation model (``games.model.observation``).

    Raises:
        ValueError: if the observations below lack a component that the view needs.
    """

    def __init__(self, env: World, view: View) -> None:
        self._view = view
        super().__init__(env)

    @property
    def observation_layout(self) -> ObservationLayout:
        names = self._view.component_names(self._layout_below)
        return replace(self._layout_below, state_names=names)

    def _bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows = [
            self._view.bounds(*bounds, self._layout_below) for bounds in zip(low, high, strict=True)
        ]
        return np.stack([row[0] for row in rows]), np.stack([row[1] for row in rows])

    def _observe(self, player: str, below: np.ndarray) -> np.ndarray:
        seen = self._function(self._layout_below.blocks(below)).ravel()
        return np.concatenate((seen, below[-1:]), dtype=below.dtype, casting="same_kind")

    def _prepare(self) -> None:
        function = observation_function(self._view, self._layout_below)
        self._function = BufferedFunction(function.map(self._layout_below.num_players))


class PartialObservation(ObservationView):
    """Each player sees the named components only, in their order.

    The paper's partial view is ``("px", "py", "heading")``.

    Raises:
        ValueError: if no component is named, or one that the observations below do not have.
    """

    def __init__(self, env: World, features: tuple[str, ...]) -> None:
        super().__init__(env, ComponentView("+".join(map(str, features)), features))


class RangeBearing(ObservationView):
    """A LiDAR-like sensor beside the road: range and bearing of each vehicle.

    Args:
        env: the world, whose observations have positions.
        position: position of the sensor, px and py [m].
        facing: direction of bearing zero [rad].
    """

    def __init__(
        self, env: World, position: tuple[float, float] = (0.0, 0.0), facing: float = 0.0
    ) -> None:
        super().__init__(env, RangeBearingView(position, facing))


def _words(key: Sequence[int]) -> np.ndarray:
    """The words (w,) that NumPy makes of a seed's integers; given these, it is twice as fast."""
    if min(key) < 0:
        raise ValueError(f"a seed is at least 0, got {min(key)}")
    sizes = [max(1, -(-value.bit_length() // 32)) for value in key]
    parts = [value.to_bytes(4 * size, "little") for value, size in zip(key, sizes, strict=True)]
    return np.frombuffer(b"".join(parts), dtype="<u4")


class _RandomSensor(_Sensor):
    """A sensor with a random stream for each observer."""

    #: Distinguishes the streams of the classes.
    key: ClassVar[int]

    def __init__(self, env: World) -> None:
        super().__init__(env)
        # Two sensors of one class must not draw the same numbers.
        self._depth = sum(getattr(type(below), "key", None) == self.key for below in _chain(env))
        self._seed_streams(int(np.random.SeedSequence().generate_state(1)[0]))

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Start:
        if seed is not None:
            self._seed_streams(seed)
        return super().reset(seed=seed, options=options)

    def _seed_streams(self, seed: int) -> None:
        self._seed = seed
        self._streams: dict[tuple[str, str], np.random.Generator] = {}

    def _stream(self, player: str, component: str = "") -> np.random.Generator:
        """The stream of an observer, or of its noise on one component."""
        stream = self._streams.get((player, component))
        if stream is None:
            name = [zlib.crc32(component.encode())] if component else []
            key = [self._seed, self.key, self._depth, player_index(player), *name]
            stream = self._streams[player, component] = np.random.default_rng(_words(key))
        return stream


class AWGN(_RandomSensor):
    """Additive white Gaussian noise on every observed component (eqn. awgn_observation).

    Each observer has one stream per name of a component, so sensors with different components agree
    in the noise on those that they share. With a covariance, draws are mixed in their order.

    Args:
        env: the world.
        sigma: standard deviation in the components' units: one number, or (d,) of d components.
        covariance: (d, d) covariance of one player's observed components, instead of ``sigma``.

    Raises:
        ValueError: unless exactly one of the two is given, with the shape and values of its kind.
    """

    key = 1

    def __init__(
        self,
        env: World,
        sigma: float | Sequence[float] | np.ndarray | None = None,
        covariance: np.ndarray | None = None,
    ) -> None:
        if (sigma is None) == (covariance is None):
            raise ValueError("AWGN needs either sigma or covariance")
        self._sigma = sigma
        self._covariance = covariance
        super().__init__(env)

    def _prepare(self) -> None:
        size = self._layout_below.state_size
        if self._covariance is None:
            root = np.diag(_standard_deviations(self._sigma, size))
        else:
            root = _covariance_root(self._covariance, size)
        self._root, self._reach = root, _NOISE_REACH * np.linalg.norm(root, axis=1)

    def _bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return low - self._reach, high + self._reach

    def _seed_streams(self, seed: int) -> None:
        super()._seed_streams(seed)
        self._ahead: dict[str, tuple[np.ndarray, int]] = {}

    def _observe(self, player: str, below: np.ndarray) -> np.ndarray:
        ahead, used = self._ahead.get(player, (below[None], 1))
        if used == len(ahead) or ahead.shape[1:] != below.shape:
            ahead, used = self._draw(player), 0
        self._ahead[player] = ahead, used + 1
        return np.asarray(below + ahead[used], dtype=below.dtype)

    def _draw(self, player: str) -> np.ndarray:
        """Noise (steps, N d + 1) of an observer's next observations; the time has none."""
        layout = self._layout_below
        draws = [
            self._stream(player, name).standard_normal((_STEPS_AHEAD, layout.num_players))
            for name in layout.state_names
        ]
        noise = np.zeros((_STEPS_AHEAD, layout.size))
        noise[:, :-1] = (np.stack(draws, axis=-1) @ self._root.T).reshape(_STEPS_AHEAD, -1)
        return noise


class Gaps(_RandomSensor):
    """Players are missed at random, as a layer decides; a missed player's block is NaN.

    Each observer misses players, itself included, independently of other observers. The observation
    spaces are ``BoxWithGaps``, which contain such observations.

    Raises:
        ValueError: at the first observation, on a mask of a wrong shape.
    """

    key = 2

    def __init__(self, env: World, layer: GapsLayer) -> None:
        self._layer = layer
        super().__init__(env)

    def _space(self, below: Box) -> Box:
        return BoxWithGaps(below.low, below.high, dtype=below.dtype)

    def _bounds(self, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return low, high

    def _observe(self, player: str, below: np.ndarray) -> np.ndarray:
        above = below.copy()
        blocks = self._layout_below.blocks(above)
        missed = np.asarray(self._layer.missed(self._stream(player), blocks), dtype=bool)
        if missed.shape != (len(blocks),):
            raise ValueError(
                f"{self._layer} missed players by a mask of the shape {missed.shape}, expected "
                f"{(len(blocks),)}"
            )
        blocks[missed] = np.nan
        return above


class DropSamples(Gaps):
    """Occlusion: with probability p a player is not seen in a step, and its block is NaN.

    Players are missed independently of each other and of what happened before. ValueError if p is
    not a probability.
    """

    def __init__(self, env: World, p: float) -> None:
        super().__init__(env, Drops(p))


class Float32(_Observing):
    """Observation and action spaces in single precision, as learners use it.

    Actions reach the world unchanged: an ``olne_action``, which is float64, keeps its digits.
    """

    def action_space(self, agent: str) -> Box:
        return self._known(("action", agent), self.env.action_space(agent), self._inside)

    def _space(self, below: Box) -> Box:
        low, high = below.low.astype(np.float32), below.high.astype(np.float32)
        return type(below)(low, high, dtype=np.float32)

    def _inside(self, below: Box) -> Box:
        """The space in single precision, none of whose bounds is rounded outwards."""
        near = self._space(below)
        low = np.where(near.low < below.low, np.nextafter(near.low, np.float32(np.inf)), near.low)
        high = np.where(
            near.high > below.high, np.nextafter(near.high, np.float32(-np.inf)), near.high
        )
        return type(below)(low, high, dtype=np.float32)

    def _observe_all(self, observations: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {player: below.astype(np.float32) for player, below in observations.items()}


def _chain(env: Any) -> Iterator[Any]:
    """The env and all that it wraps, also through converters of other libraries."""
    while env is not None:
        yield env
        env = vars(env).get("env", vars(env).get("aec_env"))


def _layout_of(env: World) -> ObservationLayout:
    """Layout of the nearest world or sensor below."""
    for below in _chain(env):
        # The class is asked, because instances of wrappers forward attributes to the env below.
        if hasattr(type(below), "observation_layout"):
            layout: ObservationLayout = below.observation_layout
            return layout
    raise ValueError(f"{env} has no observation_layout: sensors go around a world of envs")


def _standard_deviations(sigma: Any, size: int) -> np.ndarray:
    deviations = np.asarray(sigma, dtype=float)
    if deviations.shape not in ((), (size,)):
        raise ValueError(
            f"sigma has the shape {deviations.shape}, expected one number or {size} of them"
        )
    if not (np.isfinite(deviations).all() and (deviations >= 0).all()):
        raise ValueError(f"sigma must be finite and non-negative, got {sigma}")
    return np.broadcast_to(deviations, size)


def _covariance_root(covariance: np.ndarray, size: int) -> np.ndarray:
    """A matrix R with R R' = covariance, which may be singular; lower triangular if it is regular.

    Then the first components depend on the first draws only, whatever follows.
    """
    covariance = np.asarray(covariance, dtype=float)
    if covariance.shape != (size, size):
        raise ValueError(f"covariance has the shape {covariance.shape}, expected {(size, size)}")
    if not np.isfinite(covariance).all() or not np.allclose(covariance, covariance.T):
        raise ValueError(f"covariance must be finite and symmetric, got {covariance.tolist()}")
    values, vectors = np.linalg.eigh(covariance)
    if values[0] < -1e-12 * max(values[-1], 0):
        raise ValueError(f"covariance has the negative eigenvalue {values[0]:.3g}")
    if values[0] > 1e-12 * values[-1]:
        return np.linalg.cholesky(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0)))

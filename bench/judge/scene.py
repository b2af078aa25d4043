"""The truth of a draw as a store keeps it, so that a report plays no game.

What is stored may be damaged, or written by foreign code, so it is checked when it is read.
"""

import zlib
from collections.abc import Mapping
from typing import Any, Protocol

import msgspec
import numpy as np

from olne_bench.bench.process.messages import Array, pack, unpack
from olne_bench.errors import UserError
from olne_bench.games.model.identifiability import Identifiability, identified_at

#: Largest truth or motion [bytes].
_MOST_BYTES = 2**26
_MOTION = np.dtype("<f4")
_FAST = 1  # level of zlib: the others save a tenth more and take three times as long


class NoSceneError(UserError):
    """A truth or a motion is not there, or cannot be read; the message says why."""


class Quantity(msgspec.Struct, frozen=True):
    """An unknown of a player besides its weights; ``deviation`` is that of its prior."""

    name: str
    unit: str
    deviation: float


class TrueScene(msgspec.Struct, frozen=True, eq=False):
    """What a report needs of a draw that is seen through a sensor."""

    road: str  # name of its road of HighwayEnv; empty if it is not on one
    dt: float  # duration of a step [s]
    state_names: tuple[str, ...]  # n
    weight_names: tuple[str, ...]  # K
    noise_scale: tuple[float, ...]  # (n,) standard deviations of noise on a state, over sigma
    states: np.ndarray  # (T, N, n) true motion
    weights: np.ndarray  # (N, K)
    parameters: np.ndarray  # (N, U) true values of the unknowns besides weights, in their units
    unknowns: tuple[tuple[Quantity, ...], ...]  # these unknowns of each player
    information_root: np.ndarray  # (F, F) of ``games.solve.information``, if no sample is missing
    temperaments: tuple[str, ...] = ()  # of each driver, where drivers have one
    shares: dict[str, float] = {}  # of each temperament among drivers

    @property
    def used(self) -> np.ndarray:
        """(N, U) which columns of ``parameters`` stand for an unknown."""
        lengths = np.array([len(own) for own in self.unknowns], dtype=int)
        return np.arange(self.parameters.shape[1]) < lengths[:, None]

    @property
    def deviations(self) -> np.ndarray:
        """(N, U) of the priors of the unknowns; NaN in columns that stand for nothing."""
        table = np.full(self.parameters.shape, np.nan)
        table[self.used] = [one.deviation for own in self.unknowns for one in own]
        return table

    def identified_at(self, sigma: float) -> Identifiability:
        """Which weights and unknowns are identified at a noise level [m], above 0."""
        count = len(self.weight_names)
        return identified_at(self.information_root, count, self.used, sigma=sigma)


class Scenes(Protocol):
    """Where a report finds truths and motions, by labels and seeds of trials.

    Both methods raise ``NoSceneError`` where something cannot be read.
    """

    def truth(self, scenario: str, seed: int, sensor: str | None = None) -> TrueScene:
        """The truth of a draw, seen through a sensor, or any; ``NoSceneError`` without one."""

    def motion(self, trial: Mapping[Any, Any], shape: tuple[int, ...]) -> np.ndarray | None:
        """The predicted states of a trial's row, of this shape; None if it has no prediction."""


class NoScenes:
    """No truth and no motion is known, as of rows without a store."""

    def truth(self, scenario: str, seed: int, sensor: str | None = None) -> TrueScene:
        raise NoSceneError("its truth is not stored here")

    def motion(self, trial: Mapping[Any, Any], shape: tuple[int, ...]) -> np.ndarray | None:
        return None


def pack_truth(scene: TrueScene) -> bytes:
    """The form in which a truth is stored."""
    return zlib.compress(msgspec.msgpack.encode(scene, enc_hook=pack), _FAST)


def unpack_truth(content: bytes) -> TrueScene:
    """Read a stored truth; ``NoSceneError`` if it is damaged."""
    try:
        scene = msgspec.msgpack.decode(_whole(content), type=TrueScene, dec_hook=_array)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise NoSceneError(f"a stored truth is damaged: {error}") from error
    _check(scene)
    return scene


def pack_motion(states: np.ndarray) -> bytes:
    """The form in which predicted states (T, N, n) are stored, in single precision."""
    return zlib.compress(states.astype(_MOTION).tobytes(), _FAST)


def unpack_motion(content: bytes, shape: tuple[int, ...]) -> np.ndarray:
    """Read stored states; ``NoSceneError`` if they are damaged, or of another shape."""
    try:
        return np.frombuffer(_whole(content), _MOTION).reshape(shape).astype(float)
    except ValueError as error:
        raise NoSceneError(f"a stored motion is damaged: {error}") from error


def _whole(content: bytes) -> bytes:
    """The bytes that were compressed; zlib has a checksum of them."""
    try:
        reader = zlib.decompressobj()
        data = reader.decompress(content, _MOST_BYTES)
    except (zlib.error, TypeError) as error:
        raise ValueError(error) from error
    if not reader.eof:
        raise ValueError("its end is missing, or it is too large")
    return data


def _array(_: type, value: Any) -> np.ndarray:
    return unpack(msgspec.convert(value, Array))


def _check(scene: TrueScene) -> None:
    """Refuse arrays that do not fit each other: foreign code may have written them."""
    players, count, size = len(scene.unknowns), len(scene.weight_names), len(scene.noise_scale)
    width = max(map(len, scene.unknowns), default=0)
    free = players * (count - 1) + sum(map(len, scene.unknowns))
    shapes = {
        "states": (*scene.states.shape[:1], players, size),
        "weights": (players, count),
        "parameters": (players, width),
        "information_root": (free, free),
    }
    wrong = [name for name, shape in shapes.items() if getattr(scene, name).shape != shape]
    wrong += ["state_names"] * (len(scene.state_names) != size)
    wrong += ["temperaments"] * (len(scene.temperaments) not in (0, players))
    if wrong:
        raise NoSceneError(f"a stored truth is damaged: {', '.join(wrong)} of another shape")

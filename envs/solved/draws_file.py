"""Solved draws in one small file, which travels: every machine then plays the same truths.

A motion is kept as its controls in single precision, with the evidence of its certificate. Newton's
method on the machine that reads it leads back to the root, to rounding, and shows that it is one.
Draws and starts that were refused are kept by name only. Games with hard constraints are solved in
milliseconds and are not kept.

The file is a SHA-256 digest, then compressed arrays with a version. What a motion belongs to is
found by the weights and the initial state, rounded so that machines may differ in the last bits.
"""

import hashlib
import io
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import ZipFile

import numpy as np

from olne_bench.errors import UserError, bad_input
from olne_bench.files import whole_file
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.equilibrium import Certificate, Equilibrium, Gains
from olne_bench.games.model.game import Game
from olne_bench.games.solve.newton import Root, newton_root
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE

#: Version of the format and of the rules by which draws are drawn and certified.
VERSION = 1
_DIGEST = 32  # bytes of SHA-256
_KEY = 16  # bytes
_MOST_BYTES = 2**28  # of an array: 100 times all those of the largest suite that is shipped
_DIGITS = 9  # of weights and states in keys
#: Largest change of a control on the way back to the root, relative to one and its size.
_CLOSE = 1e-4
#: Names of the arrays of a motion, and their types in the file.
_TYPES = {
    "controls": "<f4",
    "costs": "<f8",
    "local": "<f4",
    "local_starts": "<u2",
    "far": "<f4",
    "far_starts": "<u2",
}


class OtherDrawsError(UserError):
    """A file of draws that does not fit: damaged, of another version, or of other code."""


class Motion(NamedTuple):
    """The controls (T-1, N, m) of an equilibrium and its evidence, each (N,)."""

    controls: np.ndarray
    costs: np.ndarray
    local: np.ndarray
    local_starts: np.ndarray
    far: np.ndarray
    far_starts: np.ndarray
    tolerance: float


@dataclass
class Draws:
    """Solved draws.

    Attributes:
        place: the file that they were read from, for messages.
        about: what they are draws of: ``suite``, ``salt_id``.
        motions: certified motions by key.
        refused: keys of games that must not be played: without a certified equilibrium, out of
            limits, or with a collision.
        digest: SHA-256 of the content of the file, as hexadecimal text.
    """

    place: str = ""
    about: dict[str, str] = field(default_factory=dict)
    motions: dict[bytes, Motion] = field(default_factory=dict)
    refused: set[bytes] = field(default_factory=set)
    digest: str = ""

    def add(self, game: Game, weights: np.ndarray, solved: Any) -> None:
        """Keep a certified motion: an ``Equilibrium`` or a ``Recording``."""
        if game.constraints:
            return
        found = solved.certificate
        far = found.global_so_far
        assert found.passed and far is not None, "a truth passes both parts"
        self.motions[key_of(game, weights, solved.states[0])] = Motion(
            solved.controls.astype("<f4"),
            found.costs,
            *(found.local.values, found.local.starts, far.values, far.starts),
            found.tolerance,
        )

    def refuse(self, game: Game, weights: np.ndarray, initial_state: np.ndarray) -> None:
        """Note that a game must not be played."""
        if not game.constraints:
            self.refused.add(key_of(game, weights, initial_state))

    def is_refused(self, game: Game, weights: np.ndarray, initial_state: np.ndarray) -> bool:
        """Whether a game was refused when the draws were made."""
        return bool(self.refused) and key_of(game, weights, initial_state) in self.refused

    def holds(self, game: Game, weights: np.ndarray, initial_state: np.ndarray) -> bool:
        """Whether the motion of a game is among the draws."""
        return bool(self.motions) and key_of(game, weights, initial_state) in self.motions

    def equilibrium(
        self, game: Game, weights: np.ndarray, initial_state: np.ndarray
    ) -> Equilibrium | None:
        """The equilibrium of a game; None if it is not among the draws.

        Raises:
            OtherDrawsError: if the kept motion is not one of this game.
        """
        kept = self.motions.get(key_of(game, weights, initial_state))
        if kept is None:
            return None
        root = _root(kept.controls.astype(float), game, weights, initial_state)
        if root is None:
            raise OtherDrawsError(
                f"draws file {self.place}: a motion in it is no equilibrium of its game, which "
                "other code has drawn; write it again with 'olne-bench draws'"
            )
        certificate = Certificate(
            kept.costs,
            kept.tolerance,
            local=Gains(kept.local.astype(float), kept.local_starts.astype(int), passed=True),
            global_so_far=Gains(kept.far.astype(float), kept.far_starts.astype(int), passed=True),
        )
        return Equilibrium(root.states, root.controls, root.costates, root.residual, certificate)

    def update(self, other: "Draws") -> None:
        """Add the motions and refusals of other draws; a motion that is here stays as it is."""
        self.motions = other.motions | self.motions
        self.refused |= other.refused


def _root(
    controls: np.ndarray, game: Game, weights: np.ndarray, initial_state: np.ndarray
) -> Root | None:
    """The root of a game that has nearly these controls; None if there is none."""
    if controls.shape != game.control_shape:
        return None
    try:
        states = rollout(game.dynamics, initial_state, controls, game.dt)
        root = newton_root(game, states, controls, np.zeros_like(states[1:]), weights)
    except (ValueError, ArithmeticError):  # controls without any bounds
        return None
    change = np.abs(root.controls - controls) / (1 + np.abs(controls))
    return root if root.residual < RESIDUAL_TOLERANCE and change.max() < _CLOSE else None


def key_of(game: Game, weights: np.ndarray, initial_state: np.ndarray) -> bytes:
    """The key of a game's draw."""
    numbers = np.concatenate([np.ravel(weights), np.ravel(initial_state)]).astype("<f8")
    rounded = np.round(numbers, _DIGITS) + 0.0  # no negative zero
    told = f"{game.horizon} {game.dt:.9g} {game.num_players} {'/'.join(game.weight_names)} "
    return hashlib.sha256(told.encode() + rounded.tobytes()).digest()[:_KEY]


def write_draws(path: Path, draws: Draws) -> None:
    """Write a file of draws, completely or not at all.

    Raises:
        UserError: if it cannot be written.
    """
    keys = sorted(draws.motions)
    motions = [draws.motions[key] for key in keys]
    tolerances = {motion.tolerance for motion in motions} or {0.0}
    assert len(tolerances) == 1, "all motions are certified to the same tolerance"
    header = {"version": VERSION, "tolerance": tolerances.pop()} | draws.about
    arrays: dict[str, Any] = {
        name: np.concatenate([np.ravel(getattr(m, name)) for m in motions] or [np.empty(0)])
        for name in _TYPES
    }
    arrays = {name: array.astype(_TYPES[name]) for name, array in arrays.items()}
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        header=np.frombuffer(json.dumps(header).encode(), np.uint8),
        keys=np.frombuffer(b"".join(keys), np.uint8),
        refused=np.frombuffer(b"".join(sorted(draws.refused)), np.uint8),
        shapes=np.array([m.controls.shape for m in motions], "<u2").reshape(-1, 3),
        **arrays,
    )
    content = buffer.getvalue()
    with whole_file(path) as unfinished:
        unfinished.write_bytes(hashlib.sha256(content).digest() + content)


def read_draws(path: Path) -> Draws:
    """Read a file of draws; the latest one is kept in memory.

    Raises:
        OtherDrawsError: if it cannot be read, its hash is wrong, or it is of another version.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise OtherDrawsError(
            f"draws file {path} cannot be read: {error.strerror or error}"
        ) from error
    digest = hashlib.sha256(content[_DIGEST:])
    if len(content) <= _DIGEST or digest.digest() != content[:_DIGEST]:
        raise OtherDrawsError(
            f"draws file {path} has a wrong hash: it is damaged, or no file of draws; remove it, "
            "or write it again with 'olne-bench draws'"
        )
    return _parsed(content, str(path), digest.hexdigest())


@lru_cache(maxsize=2)
def _parsed(content: bytes, place: str, digest: str) -> Draws:
    try:
        with bad_input(f"draws file {place} is damaged", TypeError, NotImplementedError):
            with ZipFile(io.BytesIO(content[_DIGEST:])) as archive:
                header = json.loads(_array(archive, "header", "|u1", 1).tobytes())
                if type(header) is not dict or header.pop("version", None) != VERSION:
                    raise UserError(
                        f"draws file {place} is of another version than {VERSION}, which this "
                        "olne-bench reads"
                    )
                arrays = _arrays(archive)
            tolerance = float(header.pop("tolerance"))
            if not (0 <= tolerance < 1 and all(type(text) is str for text in header.values())):
                raise ValueError("its header is not that of draws")
            refused, keys = _keys(arrays["refused"]), _keys(arrays["keys"])
            motions = dict(zip(keys, _motions(arrays, tolerance), strict=True))
            return Draws(place, header, motions, set(refused), digest)
    except UserError as error:
        raise OtherDrawsError(f"{error}; write it again with 'olne-bench draws'") from error


def _arrays(archive: ZipFile) -> dict[str, np.ndarray]:
    """The arrays of an archive, if they are what they should be.

    Raises:
        ValueError: as ``_array``.
    """
    known: dict[str, tuple[str, int]] = {name: (kind, 1) for name, kind in _TYPES.items()}
    known |= {"keys": ("|u1", 1), "refused": ("|u1", 1), "shapes": ("<u2", 2)}
    return {name: _array(archive, name, *expected) for name, expected in known.items()}


def _array(archive: ZipFile, name: str, kind: str, axes: int) -> np.ndarray:
    """An array of an archive; no memory is taken before its shape is checked.

    Raises:
        ValueError: if it is not of this type, has other axes or too many bytes, or is not finite.
    """
    if (size := archive.getinfo(f"{name}.npy").file_size) > _MOST_BYTES:
        raise ValueError(
            f"its array {name} would have {size} bytes, at most {_MOST_BYTES} are read"
        )
    with archive.open(f"{name}.npy") as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError(f"its array {name} is of another format")
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        if dtype.str != kind or len(shape) != axes:
            raise ValueError(f"its array {name} has the type {dtype} and the shape {shape}")
        data = file.read()
    if len(data) != math.prod(shape) * dtype.itemsize:
        raise ValueError(f"its array {name} has {len(data)} bytes for the shape {shape}")
    array = np.frombuffer(data, dtype).reshape(shape)
    if not np.isfinite(array).all():
        raise ValueError(f"its array {name} is not finite")
    return array


def _keys(data: np.ndarray) -> list[bytes]:
    text = data.tobytes()
    keys = [text[k : k + _KEY] for k in range(0, len(text), _KEY)]
    if len(set(keys)) != len(keys) or len(text) % _KEY:
        raise ValueError("its keys are cut off, or repeat")
    return keys


def _motions(arrays: Mapping[str, np.ndarray], tolerance: float) -> list[Motion]:
    shapes = arrays["shapes"].astype(int)
    if shapes.shape[1] != 3 or (shapes < 1).any():
        raise ValueError("its motions have impossible shapes")
    sizes = dict.fromkeys(_TYPES, shapes[:, 1].sum()) | {"controls": shapes.prod(axis=1).sum()}
    for name, size in sizes.items():
        if len(arrays[name]) != size:
            raise ValueError(f"its array {name} has {len(arrays[name])} numbers, expected {size}")
    if not len(shapes):
        return []
    players = np.cumsum(shapes[:, 1])[:-1]
    controls = np.split(arrays["controls"], np.cumsum(shapes.prod(axis=1))[:-1])
    evidence = [np.split(arrays[name], players) for name in list(_TYPES)[1:]]
    shaped = [flat.reshape(shape) for flat, shape in zip(controls, shapes, strict=True)]
    columns = (shaped, *evidence, [tolerance] * len(shapes))
    return [Motion(*values) for values in zip(*columns, strict=True)]

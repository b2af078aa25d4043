"""Solved draws in one small file, which travels: every machine then plays the same truths.

A motion is kept as its controls in single precision, with the evidence of its certificate. Newton's
method leads back to the root, to rounding, and shows that it is one. Refused draws and starts are
kept by name only, and games with hard constraints are not kept.

The file is a SHA-256 digest, then MessagePack. What a motion belongs to is found by the weights and
the initial state, rounded so that machines may differ in the last bits.
"""

import hashlib
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain
from math import prod
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from olne_bench.errors import UserError
from olne_bench.files import whole_file
from olne_bench.games.model.dynamics import rollout
from olne_bench.games.model.equilibrium import Certificate, Equilibrium, Gains
from olne_bench.games.model.game import Game
from olne_bench.games.solve.newton import Root, newton_root
from olne_bench.games.solve.olne import RESIDUAL_TOLERANCE
from olne_bench.kept_files import sealed, unsealed

#: Version of the format and of the rules by which draws are drawn and certified.
VERSION = 2
_KEY = 16  # bytes
_DIGITS = 9  # of weights and states in keys
#: Largest change of a control on the way back to the root, relative to one and its size.
_CLOSE = 1e-4
#: Types of the arrays of a motion.
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


class Solved(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """The controls of an equilibrium and its evidence, as bytes of arrays.

    Attributes:
        shape: of the controls (T-1, N, m); the other arrays are (N,).
        tolerance: of the certificate.
    """

    shape: tuple[int, int, int]
    tolerance: float
    controls: bytes
    costs: bytes
    local: bytes
    local_starts: bytes
    far: bytes
    far_starts: bytes

    @classmethod
    def of(cls, solved: Any) -> "Solved":
        """What is kept of a certified motion, an ``Equilibrium`` or a ``Recording``."""
        found = solved.certificate
        near, far = found.local, found.global_so_far
        assert found.passed and far is not None, "a truth passes both parts"
        arrays = solved.controls, found.costs, near.values, near.starts, far.values, far.starts
        packed = [a.astype(kind).tobytes() for a, kind in zip(arrays, _TYPES.values(), strict=True)]
        return cls(solved.controls.shape, found.tolerance, *packed)

    def __post_init__(self) -> None:
        """ValueError for arrays that do not fit the shape."""
        if min(self.shape) < 1 or not 0 <= self.tolerance < 1:
            raise ValueError(f"a motion of the shape {self.shape} cannot be")
        for name, kind in _TYPES.items():
            size = prod(self.shape) if name == "controls" else self.shape[1]
            if len(getattr(self, name)) != size * int(kind[2]):
                raise ValueError(f"{name} of a motion have a wrong size")

    def array(self, name: str) -> np.ndarray:
        """One of the arrays, in its own type."""
        flat = np.frombuffer(getattr(self, name), _TYPES[name])
        return flat.reshape(self.shape) if name == "controls" else flat

    def certificate(self) -> Certificate:
        """The evidence."""
        local, far = (
            Gains(self.array(n).astype(float), self.array(f"{n}_starts").astype(int), passed=True)
            for n in ("local", "far")
        )
        return Certificate(self.array("costs"), self.tolerance, local=local, global_so_far=far)


class _Content(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    version: int
    about: dict[str, str] = {}
    motions: dict[bytes, Solved] = {}
    refused: list[bytes] = []

    def __post_init__(self) -> None:
        if any(len(key) != _KEY for key in chain(self.motions, self.refused)):
            raise ValueError(f"a key has another length than {_KEY} bytes")
        for name, kind in _TYPES.items():
            together = b"".join(getattr(motion, name) for motion in self.motions.values())
            if not np.isfinite(np.frombuffer(together, kind)).all():
                raise ValueError(f"{name} of a motion are not finite")


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
    motions: dict[bytes, Solved] = field(default_factory=dict)
    refused: set[bytes] = field(default_factory=set)
    digest: str = ""

    def add(self, game: Game, weights: np.ndarray, solved: Any) -> None:
        """Keep a certified motion: an ``Equilibrium`` or a ``Recording``."""
        if not game.constraints:
            self.motions[key_of(game, weights, solved.states[0])] = Solved.of(solved)

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
        """A game's equilibrium, or None; OtherDrawsError if the kept motion is not of this game."""
        kept = self.motions.get(key_of(game, weights, initial_state))
        if kept is None:
            return None
        root = _root(kept.array("controls").astype(float), game, weights, initial_state)
        if root is None:
            raise OtherDrawsError(
                f"draws file {self.place}: a motion in it is no equilibrium of its game, which "
                "other code has drawn; write it again with 'olne-bench draws'"
            )
        return Equilibrium(
            root.states, root.controls, root.costates, root.residual, kept.certificate()
        )

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


def packed(draws: Draws) -> bytes:
    """Draws as bytes, the same for the same draws."""
    motions = dict(sorted(draws.motions.items()))
    content = _Content(VERSION, draws.about, motions, sorted(draws.refused))
    return msgspec.msgpack.encode(content)


def unpacked(content: bytes, place: str) -> Draws:
    """The draws in bytes; OtherDrawsError if they are of another version, or no draws."""
    try:
        found = msgspec.msgpack.decode(content, type=_Content)
    except msgspec.MsgspecError as error:
        raise OtherDrawsError(
            f"draws file {place} is damaged or of another version than {VERSION}, which this "
            f"olne-bench reads: {error}; write it again with 'olne-bench draws'"
        ) from error
    if found.version != VERSION:
        raise OtherDrawsError(
            f"draws file {place} is of another version than {VERSION}, which this olne-bench "
            "reads; write it again with 'olne-bench draws'"
        )
    digest = hashlib.sha256(content).hexdigest()
    return Draws(place, found.about, found.motions, set(found.refused), digest)


def write_draws(path: Path, draws: Draws) -> None:
    """Write a file of draws, completely or not at all; UserError if it cannot be written."""
    with whole_file(path) as unfinished:
        unfinished.write_bytes(sealed(packed(draws)))


def read_draws(path: Path) -> Draws:
    """Read and keep a file of draws; OtherDrawsError if it is damaged or of another version."""
    try:
        content = unsealed(path.read_bytes())
    except OSError as error:
        raise OtherDrawsError(
            f"draws file {path} cannot be read: {error.strerror or error}"
        ) from error
    if content is None:
        raise OtherDrawsError(
            f"draws file {path} has a wrong hash: it is damaged, or no file of draws; remove it, "
            "or write it again with 'olne-bench draws'"
        )
    return _latest(content, str(path))


_latest = lru_cache(maxsize=2)(unpacked)

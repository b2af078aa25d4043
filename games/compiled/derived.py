"""What is derived from a structure of games, kept on disk for other processes and later runs.

Deriving functions and writing their C source takes up to a second, reading them a hundredth. A
file's name is a digest of what it is derived from, of all Python code of ``olne_bench.games``, and
of the versions of CasADi, NumPy and Python. Nothing is kept for features and models of other
packages, whose code may change without a sign.
"""

import hashlib
import io
import pickle
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from olne_bench.kept_files import KeptFiles

#: About 1 MB for a structure of five cars.
KEPT_DERIVED = KeptFiles("-derived", most_bytes=200_000_000, shared=True)
_GAMES = Path(__file__).parents[1]
_OURS = "olne_bench.games."

_Derived = TypeVar("_Derived")


def derived(kind: str, origin: object, derive: Callable[[], _Derived]) -> _Derived:
    """What ``derive`` returns for an origin, from the folder of kept files if it is there."""
    content = _pickled(origin)
    if content is None:
        return derive()
    name = hashlib.sha256(f"{kind} {_code()} ".encode() + content).hexdigest()
    if kept := KEPT_DERIVED.read(name):
        found: _Derived = pickle.loads(kept)
        return found
    found = derive()
    KEPT_DERIVED.write(name, pickle.dumps(found, pickle.HIGHEST_PROTOCOL))
    return found


class _Pickler(pickle.Pickler):
    """Collects the packages whose classes and functions it meets."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        # Without memory of what it has met, equal values have equal pickles.
        self.fast = True
        self.modules: set[str] = set()

    def reducer_override(self, value: Any) -> Any:
        if isinstance(value, type | FunctionType):
            self.modules.add(value.__module__)
        return NotImplemented


def _pickled(origin: object) -> bytes | None:
    """The pickle of what is made of NumPy's and our games' classes; None for anything else."""
    file = io.BytesIO()
    pickler = _Pickler(file)
    try:
        pickler.dump(origin)
    except (pickle.PicklingError, AttributeError, TypeError, ValueError, RecursionError):
        return None
    known = all(_is_known(module) for module in pickler.modules)
    return file.getvalue() if known else None


def _is_known(module: str) -> bool:
    return module.startswith(_OURS) or module.split(".")[0] in ("numpy", "builtins")


@lru_cache(maxsize=1)
def _code() -> str:
    """A digest of the code and versions on which derived functions depend."""
    digest = hashlib.sha256(f"{sys.version} {ca.CasadiMeta.version()} {np.__version__}".encode())
    for path in sorted(path for path in _GAMES.rglob("*") if path.suffix == ".py"):
        digest.update(f"{path.relative_to(_GAMES)} ".encode() + path.read_bytes())
    return digest.hexdigest()

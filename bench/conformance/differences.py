"""What differs between two copies of plain data, such as a problem before and after an estimate."""

import reprlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import FunctionType
from typing import Any

import numpy as np

_ABSENT = "absent"


def find_change(before: Any, after: Any, place: str) -> str | None:
    """The first difference of plain data, such as ``game.dt was 0.1 and is 5.0``; None if equal."""
    if before is after:
        return None
    parts = _parts(before)
    if type(before) is type(after) and parts is not None:
        others = _parts(after) or {}
        for name in parts:
            found = find_change(parts[name], others.get(name, _ABSENT), f"{place}{name}")
            if found is not None:
                return found
        added = [name for name in others if name not in parts]
        return f"{place}{added[0]} was absent" if added else None
    if type(before) is type(after) and _equal(before, after):
        return None
    return f"{place} was {reprlib.repr(before)} and is {reprlib.repr(after)}"


def _parts(value: Any) -> dict[str, Any] | None:
    """The parts of a value by name; None if it is compared as a whole."""
    if is_dataclass(value):
        return {f".{f.name}": getattr(value, f.name, _ABSENT) for f in fields(value)}
    if isinstance(value, tuple | list):
        return {f"[{k}]": item for k, item in enumerate(value)}
    if isinstance(value, Mapping):
        return {f"[{key!r}]": item for key, item in value.items()}
    if hasattr(value, "__dict__") and _compares_by_identity(value):
        return {f".{name}": item for name, item in vars(value).items()}
    return None


def _compares_by_identity(value: Any) -> bool:
    equal: Any = type(value).__eq__
    return equal is object.__eq__ and not isinstance(value, FunctionType | type)


def _equal(before: Any, after: Any) -> bool:
    if isinstance(before, np.ndarray):
        if before.shape != after.shape:
            return False
        both_missing = (before != before) & (after != after)
        return bool(np.all((before == after) | both_missing))
    return bool(before == after)

"""Types of the values in suites: strict, because TOML has types, and bounded."""

import math
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

#: Longest name [characters]; a longer one could not be part of a file name.
LABEL_LENGTH = 120
_REFERENCE_LENGTH = 1000
_TEXT_LENGTH = 1000
_DEPTH = 6
_ITEMS = 10_000
_INTEGER = 2**63
_SHOWN = 120
_MESSAGE = 300


class Strict(BaseModel):
    """Immutable plain data that refuses unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, ser_json_inf_nan="constants")


def shown(value: object) -> str:
    """A value as text of bounded length, for messages."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number with too many digits, tables nested too deep
        return f"a {type(value).__name__} too large to be shown"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}... ({len(text)} characters)"


def cut(text: str) -> str:
    """A message on one line, of bounded length."""
    line = " ".join(text.split())
    return line if len(line) <= _MESSAGE else f"{line[:_MESSAGE]}..."


def _one_line(value: str) -> str:
    if not value.strip():
        raise ValueError(f"a text that is not empty is needed, got {value!r}")
    if not value.isprintable():
        raise ValueError(f"it cannot contain control characters or line breaks: {shown(value)}")
    return value


def _printable(value: str) -> str:
    return _one_line(value) if value else value


def _plain(value: dict[str, Any]) -> dict[str, Any]:
    for key, item in value.items():
        _one_line(key)
        _check_plain(key, item, depth=0)
    return value


def _check_plain(key: str, value: object, depth: int) -> None:
    """Refuse values that JSON cannot hold, that are too large, or that break a table."""
    if isinstance(value, dict | list | tuple):
        if depth == _DEPTH or len(value) > _ITEMS:
            raise ValueError(f"{key!r} is nested deeper than {_DEPTH}, or longer than {_ITEMS}")
        for name in value if isinstance(value, dict) else ():
            _one_line(str(name))
        for item in value.values() if isinstance(value, dict) else value:
            _check_plain(key, item, depth + 1)
    elif isinstance(value, str):
        if len(value) > _TEXT_LENGTH:
            raise ValueError(f"{key!r} has {len(value)} characters, at most {_TEXT_LENGTH}")
        _printable(value)
    elif isinstance(value, float) and math.isnan(value):
        raise ValueError(f"{key!r} is not a number")
    elif isinstance(value, int) and abs(value) >= _INTEGER:
        raise ValueError(f"{key!r} is a number of more than 63 bits")
    elif not isinstance(value, bool | int | float):
        raise ValueError(f"{key!r} must be a number, text, list or table, got {shown(value)}")


Text = Annotated[str, Field(max_length=_TEXT_LENGTH), AfterValidator(_printable)]
#: A name that must not be empty.
Name = Annotated[str, Field(max_length=LABEL_LENGTH), AfterValidator(_one_line)]
#: A name that is empty if the suite does not give one.
Label = Annotated[str, Field(max_length=LABEL_LENGTH), AfterValidator(_printable)]
#: A name of a plugin, or its file.
Reference = Annotated[str, Field(max_length=_REFERENCE_LENGTH), AfterValidator(_one_line)]
Parameters = Annotated[dict[str, Any], AfterValidator(_plain)]

Sigma = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False, strict=True)]
Bound = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Seconds = Annotated[float, Field(gt=0, le=7 * 86400, allow_inf_nan=False, strict=True)]
Seeds = Annotated[int, Field(gt=0, le=10**8, strict=True)]
Iterations = Annotated[int, Field(ge=0, le=10**6, strict=True)]
Trajectories = Annotated[int, Field(gt=0, le=1000, strict=True)]

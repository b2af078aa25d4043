"""Checks of numbers in the input of suites and callers."""

from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import ValidationError

_MOST = 10**6
_LONGEST_KEY = 100  # characters of a key in a message


def check_number(name: str, value: Any, least: float = 1e-6, most: float = 1e3) -> None:
    """Refuse a value that is not a number within bounds."""
    number = isinstance(value, Real) and not isinstance(value, bool)
    if not (number and least <= value <= most):
        raise ValueError(f"{name} must be a number of {least:g} to {most:g}, got {as_text(value)}")


def check_count(name: str, value: Any, least: int = 1, most: int = _MOST) -> None:
    """Refuse a value that is not a whole number within bounds."""
    if not (is_whole(value) and least <= value <= most):
        raise ValueError(f"{name} must be an integer of {least} to {most}, got {as_text(value)}")


def check_whole(name: str, value: Any) -> None:
    """Refuse a value that is not a whole number; the caller checks bounds."""
    if not is_whole(value):
        raise ValueError(f"{name} must be a whole number, got {as_text(value)}")


def is_whole(value: Any) -> bool:
    """Whether a value is an integer of Python or NumPy; booleans are not."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def first_problem(error: "ValidationError") -> str:
    """The place and the text of the first problem that pydantic found, on one line."""
    problem = error.errors()[0]
    place = ".".join(str(part)[:_LONGEST_KEY] for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    return f"{place + ': ' if place else ''}{message}"


def as_text(value: Any) -> str:
    """A value as text; huge integers are described, as Python refuses to print them."""
    if is_whole(value) and abs(int(value)) >= 10**20:
        return f"a number of {int(value).bit_length()} bits"
    return str(value) if is_whole(value) else repr(value)

"""Checks of numbers that suites and callers give as they like."""

from numbers import Integral, Real
from typing import Any

_MOST = 10**6


def check_number(name: str, value: Any, least: float = 1e-6, most: float = 1e3) -> None:
    """Refuse what is not a number within bounds.

    Raises:
        ValueError: naming parameter, value and range.
    """
    number = isinstance(value, Real) and not isinstance(value, bool)
    if not (number and least <= value <= most):
        raise ValueError(f"{name} must be a number of {least:g} to {most:g}, got {value!r}")


def check_count(name: str, value: Any, least: int = 1, most: int = _MOST) -> None:
    """Refuse what is not a whole number within bounds.

    Raises:
        ValueError: naming parameter, value and range.
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not (whole and least <= value <= most):
        raise ValueError(f"{name} must be an integer of {least} to {most}, got {value!r}")

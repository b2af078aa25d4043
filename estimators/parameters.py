"""Checks of estimators' parameters, which suites give as they like."""

from typing import Any

_MOST = 10**6


def check_number(name: str, value: Any, least: float = 1e-6, most: float = 1e3) -> None:
    """Refuse what is not a number within bounds.

    Raises:
        ValueError: naming parameter, value and range.
    """
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (number and least <= value <= most):
        raise ValueError(f"{name} must be a number of {least:g} to {most:g}, got {value!r}")


def check_count(name: str, value: Any, least: int = 1) -> None:
    """Refuse what is not a whole number of at least a bound.

    Raises:
        ValueError: naming parameter, value and range.
    """
    whole = isinstance(value, int) and not isinstance(value, bool)
    if not (whole and least <= value <= _MOST):
        raise ValueError(f"{name} must be an integer of {least} to {_MOST}, got {value!r}")

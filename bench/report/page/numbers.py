"""Numbers for the page: short, and without values that JSON does not have."""

import math

import numpy as np


def rounded(values: np.ndarray, digits: int = 4) -> list[float | None]:
    """Numbers rounded to significant digits; None for those that are not finite."""
    return [float(f"{v:.{digits - 1}e}") if math.isfinite(v) else None for v in values.tolist()]


def decimals(values: np.ndarray, places: int) -> list:
    """Nested lists of an array rounded to decimal places."""
    return np.round(values, places).tolist()


def human(value: float | None) -> str:
    """A number for people: two or three digits, or a dash if there is none."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    if abs(value) < _ROUNDING:
        return "0" if value == 0 else "≈ 0"
    if abs(value) >= 1e5:
        return _power(value)
    if abs(value) >= 99.5:
        return f"{value:.0f}"
    if abs(value) >= 1e-4:
        return f"{value:.2g}"
    return _power(value)


def percent(share: float) -> str:
    """A share in percent, or a dash if there is none."""
    return "–" if math.isnan(share) else f"{100 * share:.3g} %"


def chance(p: float) -> str:
    """A p-value for people."""
    if math.isnan(p):
        return "–"
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


def _power(value: float) -> str:
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_SUPERSCRIPTS)}"


#: Errors below this are rounding of solvers.
_ROUNDING = 1e-9
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

"""CasADi's functions for four numbers at a time."""

import ctypes

import casadi as ca
import numpy as np
import pytest

from olne_bench.games.compiled.bindings import vector_pointer
from olne_bench.games.compiled.compiler import load
from olne_bench.games.compiled.four_games import FLAGS
from olne_bench.games.compiled.source import four_of, text_of


@pytest.fixture(scope="module")
def evaluated() -> tuple[ca.Function, ctypes.CDLL]:
    """Everything that CasADi's graphs are made of, and the same for four pairs (x, y)."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    near = x / (1 + x**2)
    values = [
        *(f(x) for f in (ca.sin, ca.cos, ca.tan, ca.atan, ca.tanh, ca.asinh, ca.floor, ca.ceil)),
        *(f(near) for f in (ca.asin, ca.acos, ca.sinh, ca.cosh, ca.atanh, ca.exp, ca.expm1)),
        *(f(x**2) for f in (ca.acosh, ca.sqrt, ca.log1p, ca.erf)),
        *(f(x) for f in (ca.fabs, ca.sign)),
        *(ca.log(1 + x**2), (1 + x**2) ** y, x**2, x**3, 1 / x, -x, 2 * x, x + 0.1),
        *(f(x, y) for f in (ca.fmod, ca.atan2, ca.copysign, ca.fmin, ca.fmax, ca.hypot)),
        *(x < y, x <= y, x == y, x != y, ca.logic_and(x, y), ca.logic_or(x, y), ca.logic_not(y)),
        *(ca.if_else(x < y, x, y), ca.remainder(x, y), ca.fmin(x, np.inf)),
    ]
    function = ca.Function("every", [x, y], [ca.vertcat(*values)])
    loop = """
API void rows(int count, const real *x, const real *y, real *out)
{
    for (int k = 0; k < count; k++) {
        const real *arguments[] = {x + k, y + k};
        real *results[] = {out + k * SIZE};
        every(arguments, results, 0, 0, 0);
    }
}
"""
    size = f"#define SIZE {function.numel_out(0)}\n"
    library = load(text_of("four.c") + four_of({"every": function}) + size + loop, *FLAGS)
    library.rows.argtypes = [ctypes.c_int, *[vector_pointer(1)] * 2, vector_pointer(1, output=True)]
    return function, library


def _aligned(count: int) -> np.ndarray:
    memory = np.zeros(count + 4)
    first = -memory.ctypes.data % 32 // 8
    return memory[first : first + count]


def test_each_function_is_that_of_one_number(evaluated: tuple[ca.Function, ctypes.CDLL]) -> None:
    function, library = evaluated
    rng = np.random.default_rng(0)
    x, y, size = _aligned(400), _aligned(400), function.numel_out(0)
    sizes = 10.0 ** rng.uniform(-8, 2, 400)
    x[:] = sizes * rng.standard_normal(400)
    y[:] = rng.choice([0.5, 1.5, -2.0, 0.0], 400)
    x[:8] = [0, 1e6, -1e9, 0.5, -2, 1.5, np.pi, np.pi / 2]
    out = _aligned(400 * size)
    library.rows(100, x, y, out)
    found = out.reshape(100, size, 4).transpose(0, 2, 1).reshape(400, size)
    wanted = np.array(function.map(400)(x[None], y[None])).T
    np.testing.assert_allclose(found, wanted, rtol=2e-15, atol=1e-300)


def test_sines_are_exact_to_rounding(evaluated: tuple[ca.Function, ctypes.CDLL]) -> None:
    """Also next to multiples of a quarter turn, where a sloppy reduction would lose digits."""
    function, library = evaluated
    quarters = np.arange(-64, 64) * np.pi / 2
    around = np.concatenate([quarters, np.nextafter(quarters, 9e9), quarters + 1e-5])
    x, y, size = _aligned(len(around)), _aligned(len(around)), function.numel_out(0)
    x[:] = around
    out = _aligned(len(around) * size)
    library.rows(len(around) // 4, x, y, out)
    found = out.reshape(-1, size, 4).transpose(0, 2, 1).reshape(-1, size)
    np.testing.assert_allclose(found[:, 0], np.sin(around), rtol=1e-15)
    np.testing.assert_allclose(found[:, 1], np.cos(around), rtol=1e-15)


def test_every_function_of_a_nan_is_one(evaluated: tuple[ca.Function, ctypes.CDLL]) -> None:
    function, library = evaluated
    x, y, size = _aligned(4), _aligned(4), function.numel_out(0)
    x[:], y[:] = [np.nan, np.inf, 0.3, 1e7], 1.5
    out = _aligned(4 * size)
    library.rows(1, x, y, out)
    wanted = np.array(function.map(4)(x[None], y[None])).T
    np.testing.assert_allclose(out.reshape(size, 4).T, wanted, rtol=2e-15)

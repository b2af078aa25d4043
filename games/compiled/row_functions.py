"""CasADi functions evaluated for every row of NumPy arrays, by a loop compiled with their C code.

Where native code does not work, CasADi's own ``map`` does the same.
"""

import ctypes
from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from olne_bench.games.compiled import compiler
from olne_bench.games.compiled.buffered import BufferedFunction, require_dense

_LOOP = """
__attribute__((visibility("default")))
int rows_{name}(int count, const double *const *arguments, double *result) {{
    static const int sizes[] = {{{sizes}}};
    const double *arg[{sz_arg}];
    double *res[{sz_res}], w[{sz_w}];
    int iw[{sz_iw}];
    for (int row = 0; row < count; ++row) {{
        for (int i = 0; i < {n_in}; ++i)
            arg[i] = arguments[i] + (long)row * sizes[i];
        res[0] = result + (long)row * {size_out};
        if ({name}(arg, res, iw, w, 0))
            return 1;
    }}
    return 0;
}}
"""


class RowFunction:
    """Evaluates a CasADi function of one result for every row of its arguments.

    A matrix (n, m) among arguments and result is a row of n * m numbers, column by column. The
    library holds the compiled loop; None evaluates the function with CasADi. ValueError if an
    argument or the result has structural zeros.
    """

    def __init__(self, function: ca.Function, library: ctypes.CDLL | None) -> None:
        require_dense(function)
        self._function = function
        self._sizes = [function.nnz_in(i) for i in range(function.n_in())]
        self._size = function.nnz_out(0)
        self._loop = None if library is None else library[f"rows_{function.name()}"]
        self._pointers = (ctypes.c_void_p * len(self._sizes))()
        self._mapped = lru_cache(maxsize=64)(self._map)

    def __call__(self, *arguments: np.ndarray) -> np.ndarray:
        """The results (R, size) of arguments (R, ...); ValueError on a wrong number of entries."""
        count = len(arguments[0])
        if not count:
            return np.empty((0, self._size))
        rows = [
            np.ascontiguousarray(argument, dtype=float).reshape(count, size)
            for argument, size in zip(arguments, self._sizes, strict=True)
        ]
        if self._loop is None:
            return self._by_casadi(rows, count)
        result = np.empty((count, self._size))
        for index, argument in enumerate(rows):
            self._pointers[index] = argument.ctypes.data
        if self._loop(count, self._pointers, ctypes.c_void_p(result.ctypes.data)):
            raise ValueError(f"{self._function} cannot be evaluated")
        return result

    def _by_casadi(self, rows: Sequence[np.ndarray], count: int) -> np.ndarray:
        """Results of so many rows; those up to a power of two are zero, so few functions do."""
        whole, arguments = 1 << (count - 1).bit_length(), []
        for i, own in enumerate(rows):
            padded = np.zeros((whole, own.shape[1]))
            padded[:count] = own
            arguments.append(padded.reshape(-1, self._function.size1_in(i)))
        return self._mapped(whole)(*arguments).reshape(whole, self._size)[:count]

    def _map(self, count: int) -> BufferedFunction:
        return BufferedFunction(self._function.map(count))


def row_functions(functions: Sequence[ca.Function], *flags: str) -> list[RowFunction]:
    """Row functions that share one library, compiled with further flags; each has its own name."""
    generator = ca.CodeGenerator("rows", {"casadi_int": "int"})
    for function in functions:
        generator.add(function)
    loops = [_LOOP.format(**_numbers(function)) for function in functions]
    head = "#define CASADI_SYMBOL_EXPORT static"
    library = compiler.load("\n".join([head, generator.dump(), *loops]), *flags)
    return [RowFunction(function, library) for function in functions]


def _numbers(function: ca.Function) -> dict[str, object]:
    """What the C loop of a function is made of; arrays have at least one entry."""
    sizes = [function.nnz_in(i) for i in range(function.n_in())]
    room = {
        name: max(1, getattr(function, name)()) for name in ("sz_arg", "sz_res", "sz_w", "sz_iw")
    }
    return {
        "name": function.name(),
        "sizes": ", ".join(map(str, sizes)),
        "n_in": len(sizes),
        "size_out": function.nnz_out(0),
        **room,
    }

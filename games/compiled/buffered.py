"""CasADi functions on NumPy arrays with memory that is bound once, for worlds that go step by step.

A plain call of a small function takes some 100 microseconds of conversion, this about one.
"""

from typing import Any

import casadi as ca
import numpy as np


def require_dense(function: ca.Function) -> None:
    """ValueError if an argument or the first result has structural zeros, which have no memory."""
    patterns = [function.sparsity_in(i) for i in range(function.n_in())]
    if not all(pattern.is_dense() for pattern in [*patterns, function.sparsity_out(0)]):
        raise ValueError(f"{function} is not dense")


class BufferedFunction:
    """A dense CasADi function with bound memory for its arguments and result.

    CasADi stores arrays by columns and NumPy by rows, so a CasADi argument (n, N) is a NumPy array
    (N, n) here. An instance must not be used by two threads at once.
    """

    def __init__(self, function: ca.Function) -> None:
        require_dense(function)
        self._function = function
        self._arguments = [np.zeros(function.size_in(i)[::-1]) for i in range(function.n_in())]
        self._result = np.zeros(function.size_out(0)[::-1])
        # The bound buffer must outlive this method, so it is an attribute.
        self._buffer: Any
        self._buffer, self._evaluate = function.buffer()
        for i, argument in enumerate(self._arguments):
            self._buffer.set_arg(i, argument.data)
        self._buffer.set_res(0, self._result.data)

    def __reduce__(self) -> tuple[type["BufferedFunction"], tuple[ca.Function]]:
        """Copies and unpickled instances bind new memory."""
        return BufferedFunction, (self._function,)

    def __call__(self, *arguments: np.ndarray) -> np.ndarray:
        """The function's first result, transposed like the arguments, as a new array."""
        for memory, argument in zip(self._arguments, arguments, strict=True):
            memory[...] = argument
        self._evaluate()
        return self._result.copy()

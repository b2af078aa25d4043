"""The squared error of one player's samples, in a library that all games of a view share.

It is small and compiled in a moment, so another sensor does not compile a whole game again.
"""

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from olne_bench.games.compiled.compiler import load
from olne_bench.games.compiled.source import generated
from olne_bench.games.compiled.stage_patterns import half, nonzeros
from olne_bench.games.model.dynamics import Dynamics
from olne_bench.games.model.numbers import numbers_of, view_and_numbers, with_symbols
from olne_bench.games.model.observation import View, observation_size

_EXPORT = '#define CASADI_SYMBOL_EXPORT __attribute__((visibility("default")))\n#include <math.h>\n'


@dataclass(frozen=True, eq=False)
class Loss:
    """Sum (precision (y - h(x)))^2 of one player's samples, its gradient and its Hessian.

    The functions of ``library`` take (x (n,), y (d,), precision (d,), numbers of the view (P,)):
    ``loss`` has the sum and its gradient (n,), ``loss_hessian`` the nonzeros of the upper triangle
    of its Hessian, with half the diagonal, which sit at ``places`` of (n, n).
    """

    library: ctypes.CDLL
    num_samples: int  # d
    num_numbers: int  # P
    places: np.ndarray

    def fields(self) -> dict[str, Any]:
        """What ``games.compiled.bindings.Work`` holds of it; valid while this object lives."""
        addresses = {
            name: ctypes.cast(self.library[name], ctypes.c_void_p).value
            for name in ("loss", "loss_hessian")
        }
        numbers = {"num_samples": self.num_samples, "loss_nonzeros": len(self.places)}
        return addresses | numbers | {"loss_places": self.places.ctypes.data}


def loss_and_numbers(view: View, dynamics: Dynamics) -> tuple[Loss, np.ndarray]:
    """The loss of a view, and the numbers (P,) of this one."""
    structure, numbers = view_and_numbers(view, dynamics)
    return _loss(structure, dynamics), numbers


@lru_cache(maxsize=64)
def _loss(view: View, dynamics: Dynamics) -> Loss:
    """Squared error of the samples, each times its precision (eqn. inverse_approach)."""
    state = ca.SX.sym("x", dynamics.state_size)
    sample = ca.SX.sym("y", observation_size(view, dynamics))
    precision = ca.SX.sym("precision", sample.numel())
    numbers = ca.SX.sym("numbers", len(numbers_of(view)))
    expected = with_symbols(view, numbers).expected(state, dynamics)
    loss = ca.sumsqr(precision * (sample - expected))
    pattern, values = nonzeros("H", half(ca.hessian(loss, state)[0]))
    arguments = [state, sample, precision, numbers]
    column = ca.densify(ca.vertcat(loss, ca.gradient(loss, state)))
    functions = {
        "loss": ca.Function("loss", arguments, [column]),
        "loss_hessian": ca.Function("loss_hessian", arguments, [ca.densify(values)]),
    }
    return Loss(
        library=load(_EXPORT + generated(functions)),
        num_samples=sample.numel(),
        num_numbers=numbers.numel(),
        places=(pattern.rows * dynamics.state_size + pattern.columns).astype(np.int32),
    )

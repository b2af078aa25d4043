"""Four games of one structure at a time: ``four.c``, whose numbers have a slot for each game."""

import numpy as np

from olne_bench.games.compiled.bindings import Work, declared
from olne_bench.games.compiled.compiler import load
from olne_bench.games.compiled.source import source_of_four
from olne_bench.games.compiled.stage_functions import StageFunctions

_SLOTS, _ALIGNMENT = 4, 32  # [bytes]

#: Sums keep their order, so that no slot's result depends on how the compiler sees the others.
FLAGS = ("-fno-associative-math",)


def work_space(stages: StageFunctions, horizon: int, *slots: int) -> dict[str, np.ndarray]:
    """The arrays of ``Work`` that C writes to."""
    nx, nu, size, theta = stages.num_states, stages.num_controls, stages.size, stages.num_weights
    columns, curvatures = nx + theta, (stages.curvature.size, stages.final_curvature.size)
    shapes = {
        "blocks": (horizon, sum(pattern.size for pattern in stages.blocks)),
        "curvature": (horizon, max(curvatures)),
        "V": (horizon, nx, nx),
        "M": (horizon, nu, nu),
        "K": (horizon, nu, nx),
        "S": (horizon, nu, nx),
        "L": (horizon, nx, nu),
        "G": (horizon, nu, columns),
        "v": (horizon, nx, theta),
        "Z": (horizon, size, columns),
        "squares": (3, max(columns, nx + nu) ** 2),
        "parts": (nu * nu + (nx + 2 * nu) * columns,),
        "scratch": (5, horizon, size),
    }
    return {name: _aligned((*shape, *slots)) for name, shape in shapes.items()}


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros that begin where a vector of four numbers may."""
    count = int(np.prod(shape))
    memory = np.zeros(count + _ALIGNMENT // 8)
    first = -memory.ctypes.data % _ALIGNMENT // 8
    return memory[first : first + count].reshape(shape)


class FourGames:
    """Work space and library for four games that differ in weights and initial states."""

    def __init__(self, stages: StageFunctions, horizon: int, numbers: np.ndarray) -> None:
        """Numbers (N, P) are those of all four."""
        source, functions = source_of_four(stages)
        self.library = declared(load(source, *FLAGS, shared=(functions,)))
        self._arrays = work_space(stages, horizon, _SLOTS)
        self._arrays["numbers"] = _aligned((*numbers.shape, _SLOTS))
        self._arrays["numbers"][:] = numbers[..., None]
        pointers = {name: array.ctypes.data for name, array in self._arrays.items()}
        self.work = Work(horizon, **pointers)

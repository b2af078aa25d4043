"""The boundary to C: types of its functions, and checks of what is passed to them.

Callers bring arrays to aligned, dense float64 and compare shapes (``dense``); ``ndpointer`` holds
the C signatures to it. The size of every struct that is mirrored here is compared with that of C.
"""

import ctypes
from functools import lru_cache

import numpy as np
from numpy.ctypeslib import ndpointer

LARGEST_INT = 2**31 - 1


class Work(ctypes.Structure):
    """Mirrors ``Work`` of ``stages.c``."""

    _fields_ = (
        ("horizon", ctypes.c_int),
        *[
            (name, ctypes.c_void_p)
            for name in (
                *("numbers", "view_numbers", "constraint_numbers", "samples", "precision"),
                *("blocks", "curvature", "V", "M", "K", "S", "L", "G", "v", "Z", "squares"),
                *("parts", "scratch"),
            )
        ],
        ("shift", ctypes.c_double),
        ("enforced", ctypes.c_void_p),
        ("relaxation", ctypes.c_double),
        ("num_samples", ctypes.c_int),
        ("loss_nonzeros", ctypes.c_int),
        *[(name, ctypes.c_void_p) for name in ("loss", "loss_hessian", "loss_places")],
    )


def dense(name: str, array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The array as C reads it, copied only if it must be; ValueError if its shape is another."""
    array = np.require(array, np.float64, ("C_CONTIGUOUS", "ALIGNED"))
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}, expected {shape}")
    return array


def vector_pointer(ndim: int, *, output: bool = False) -> type:
    """The C type of a pointer to a dense float64 array; ``output`` where the function writes."""
    if output:
        return ndpointer(dtype=np.float64, ndim=ndim, flags=("C", "ALIGNED", "WRITEABLE"))
    return ndpointer(dtype=np.float64, ndim=ndim, flags=("C", "ALIGNED"))


def check_size(in_c: int, here: int, name: str) -> None:
    """RuntimeError if the sizes [bytes] of a C struct and of its mirror here differ."""
    if in_c != here:
        raise RuntimeError(f"the C struct {name} has {in_c} bytes, its mirror in Python {here}")


def declared(library: ctypes.CDLL) -> ctypes.CDLL:
    """The library, with the types of its functions' arguments and results."""
    for name, (result, arguments) in _signatures().items():
        if hasattr(library, name):  # games without constraints have no interior point method
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    check_size(library.work_size(), ctypes.sizeof(Work), "Work")
    return library


@lru_cache(maxsize=1)
def _signatures() -> dict[str, tuple[object, list[object]]]:
    """Types of results and arguments of the functions of ``elimination.c`` and its companions."""
    work, real, integer = ctypes.POINTER(Work), ctypes.c_double, ctypes.c_int
    vector, rows = vector_pointer(1), vector_pointer(2)
    new_vector, new_rows = (vector_pointer(ndim, output=True) for ndim in (1, 2))
    counts = ndpointer(dtype=np.int32, ndim=1, flags=("C_CONTIGUOUS", "WRITEABLE"))
    flags = ndpointer(dtype=np.bool_, ndim=2, flags="C_CONTIGUOUS")
    return _of_batches() | {
        "work_size": (integer, []),
        "evaluate": (None, [work, rows, vector, new_rows]),
        "observation_loss": (real, [work, rows, new_rows]),
        "linearise": (integer, [work, rows, vector]),
        "linearise_condensed": (integer, [work, rows, vector, rows, rows, real]),
        "margins": (None, [work, rows, new_rows]),
        "push": (None, [work, rows, rows, new_rows]),
        "change": (None, [work, rows, rows, new_rows]),
        "step_margins": (None, [work, rows, vector, new_rows]),
        "solve": (None, [work, integer, rows, new_rows]),
        "sensitivities": (None, [work]),
        "reduced_hessian": (None, [work, rows, vector, rows, new_rows]),
        "trajectory_metric": (None, [work, new_rows]),
        "hessian_product": (None, [work, rows, vector, new_rows, new_vector]),
        "reduce": (None, [work, rows, new_vector]),
        "expand": (None, [work, vector, new_rows]),
        "costs": (None, [work, rows, vector, new_vector]),
        "response_space": (integer, [integer]),
        "interior_space": (integer, [integer]),
        "interior_options": (integer, []),
        "interior": (
            integer,
            [
                *(work, vector, vector, flags, integer, real, real, integer),
                *(new_rows, new_rows, new_vector, counts, new_vector),
            ],
        ),
    }


def _of_batches() -> dict[str, tuple[object, list[object]]]:
    """The same of those that take several games or plans, or several rounds."""
    work, real, integer = ctypes.POINTER(Work), ctypes.c_double, ctypes.c_int
    vector, rows, batch, seen = (vector_pointer(ndim) for ndim in (1, 2, 3, 5))
    new_vector, new_rows, new_batch, new_slopes = (
        vector_pointer(ndim, output=True) for ndim in (1, 2, 3, 5)
    )
    counts = ndpointer(dtype=np.int32, ndim=1, flags=("C_CONTIGUOUS", "WRITEABLE"))
    return {
        "responses": (
            None,
            [
                *(work, integer, integer, rows, vector, real, integer),
                *(new_batch, new_batch, new_vector, counts, counts, new_vector),
            ],
        ),
        "respond_in_turn": (
            integer,
            [work, integer, new_rows, vector, real, real, real, *(integer,) * 3, new_vector],
        ),
        "newton": (
            None,
            [work, integer, new_batch, rows, real, integer, real, integer, new_vector, counts],
        ),
        "observe_sensitivities": (
            None,
            [work, integer, integer, batch, rows, seen, new_slopes, counts],
        ),
    }

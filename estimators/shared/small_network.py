"""A small feed-forward network in NumPy, trained in PyTorch: linear layers with SiLU in between."""

from typing import TypeAlias

import numpy as np
from numpy.lib.npyio import NpzFile
from scipy.special import expit

#: Matrices (out, in) and offsets (out,), the first layer first.
Layers: TypeAlias = tuple[tuple[np.ndarray, np.ndarray], ...]


def layers_of(file: NpzFile) -> Layers:
    """The layers ``matrix_0``, ``offset_0``, ... of a file, in single precision."""
    count = sum(name.startswith("matrix_") for name in file.files)
    pairs = [(file[f"matrix_{k}"], file[f"offset_{k}"]) for k in range(count)]
    return tuple((m.astype(np.float32), o.astype(np.float32)) for m, o in pairs)


def output(layers: Layers, values: np.ndarray) -> np.ndarray:
    """Outputs (out,) for inputs (in,)."""
    for matrix, offset in layers[:-1]:
        values = matrix @ values + offset
        values = values * expit(values)
    matrix, offset = layers[-1]
    return np.asarray(matrix @ values + offset, dtype=float)

"""Settings with which the same code gives the same numbers on all processors of one kind.

NumPy and OpenBLAS have several versions of a function and take the widest that the processor
offers. Their last digits differ. Native code is compiled for x86-64 with AVX2 and FMA
(``games.compiler``); here the two libraries are held to the same kind.
"""

import os
from collections.abc import Mapping

import numpy as np

_FEATURES = "NPY_DISABLE_CPU_FEATURES"
#: Names of AVX2 and FMA together, from NumPy 2.4 on and before, and of wider vectors.
_WIDE = ({"X86_V3"}, {"AVX2", "FMA3"})
_WIDER = ("X86_V4", "AVX512")

# Threads would compete with the other processes, and would sum in another order. That can change
# where an interior-point method ends in a hopeless game, and so can the order of sets.
_IN_ORDER = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}


def same_arithmetic() -> Mapping[str, str]:
    """Environment variables of a process that is to compute as others do.

    On a processor without AVX2 and FMA, the libraries still choose.
    """
    simd = np.show_config(mode="dicts").get("SIMD Extensions", {})
    found = simd.get("found", [])
    there = {*simd.get("baseline", []), *found}
    # Only x86-64 has features of these names.
    if not any(names <= there for names in _WIDE):
        return _IN_ORDER
    # What is switched off already is not found.
    off = os.environ.get(_FEATURES, "").replace(",", " ").split()
    off += [name for name in found if name.startswith(_WIDER)]
    return _IN_ORDER | {"OPENBLAS_CORETYPE": "Haswell", _FEATURES: " ".join(off)}

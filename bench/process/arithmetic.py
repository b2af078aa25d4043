"""Settings with which the same code gives the same numbers on all processors of one kind.

NumPy and OpenBLAS have several versions of a function and take the widest that the processor
offers. Their last digits differ. Native code is compiled for x86-64 with AVX2 and FMA
(``games.compiled.compiler``); here the two libraries are held to the same kind.
"""

import os
import platform
from collections.abc import Mapping

import numpy as np
from threadpoolctl import threadpool_info

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
    if not _is_wide():
        return _IN_ORDER
    # What is switched off already is not found.
    off = os.environ.get(_FEATURES, "").replace(",", " ").split()
    off += [name for name in _simd()["found"] if name.startswith(_WIDER)]
    return _IN_ORDER | {"OPENBLAS_CORETYPE": "Haswell", _FEATURES: " ".join(off)}


def arithmetic() -> str:
    """Whose functions give last digits: the C library, and the kind of processor.

    It is the same in this process and in those that have ``same_arithmetic``. Between two of them
    rows may differ in the last digits, and in outcome on hopeless games.
    """
    other = f"{platform.system()} {platform.mac_ver()[0]}"
    library = (" ".join(platform.libc_ver()).strip() or other).strip()
    machine = platform.machine()
    if _is_wide():
        return f"{machine}, held to AVX2 and FMA, {library}"
    # The libraries choose by what they find, so all of that is said.
    found = ", ".join(sorted({*_simd()["baseline"], *_simd()["found"]}))
    kinds = {str(one.get("architecture")) for one in threadpool_info() if one["user_api"] == "blas"}
    return f"{machine}, {found}, BLAS for {', '.join(sorted(kinds)) or 'no known kind'}, {library}"


def _is_wide() -> bool:
    """Whether the processor has AVX2 and FMA, and NumPy may use them."""
    there = {*_simd()["baseline"], *_simd()["found"]}
    # Only x86-64 has features of these names.
    return any(names <= there for names in _WIDE)


def _simd() -> dict[str, list[str]]:
    """What NumPy says of the processor: what it needs, and what it has found beside."""
    said = np.show_config(mode="dicts").get("SIMD Extensions", {})
    return {"baseline": said.get("baseline", []), "found": said.get("found", [])}

"""Processes compute the same numbers, whatever their processor offers."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from olne_bench.bench.process.arithmetic import arithmetic, same_arithmetic
from olne_bench.bench.process.child import Child


def digest() -> str:
    """Of numbers whose last digits show which functions made them."""
    numbers = np.random.default_rng(0).normal(size=(60, 60))
    made = [numbers @ numbers, np.linalg.inv(numbers), np.exp(numbers), np.abs(numbers) ** 1.3]
    return hashlib.sha256(b"".join(one.tobytes() for one in made)).hexdigest()


def in_child(function) -> str:
    child = Child(restricted=True, memory=2**30)
    try:
        return child.call(function, kind=str, seconds=60)
    finally:
        child.stop()


@pytest.fixture
def simd(monkeypatch):
    """Sets what NumPy says it found."""

    def say(**found: list[str]) -> None:
        monkeypatch.setattr(np, "show_config", lambda **_: {"SIMD Extensions": found})

    monkeypatch.delenv("NPY_DISABLE_CPU_FEATURES", raising=False)
    return say


def test_children_compute_alike_where_the_parent_was_told_to_differ(monkeypatch):
    if "OPENBLAS_CORETYPE" not in same_arithmetic():
        assert in_child(digest) == in_child(digest)
        return
    usual = in_child(digest)
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Nehalem")
    assert in_child(digest) == usual


@pytest.mark.parametrize(
    ("found", "off"),
    [
        (["X86_V3"], ""),
        (["X86_V3", "X86_V4", "AVX512_ICL"], "X86_V4 AVX512_ICL"),
        (["SSE41", "AVX2", "FMA3", "AVX512F", "AVX512_SKX"], "AVX512F AVX512_SKX"),
    ],
)
def test_wider_vectors_are_off(simd, found, off):
    simd(baseline=["X86_V2"], found=found)
    settings = same_arithmetic()
    assert settings["OPENBLAS_CORETYPE"] == "Haswell"
    assert settings["NPY_DISABLE_CPU_FEATURES"] == off


def test_what_was_off_stays_off(simd, monkeypatch):
    simd(baseline=["X86_V3"], found=["AVX512_ICL"])
    monkeypatch.setenv("NPY_DISABLE_CPU_FEATURES", "X86_V4,AVX512_SPR")
    assert same_arithmetic()["NPY_DISABLE_CPU_FEATURES"] == "X86_V4 AVX512_SPR AVX512_ICL"


@pytest.mark.parametrize(
    "said",
    [
        {"baseline": ["X86_V2"], "found": ["AVX2"]},
        {"baseline": ["NEON", "ASIMD"], "found": ["ASIMDHP", "SVE"]},
        {},
    ],
)
def test_other_processors_keep_what_their_libraries_choose(simd, said):
    simd(**said)
    settings = same_arithmetic()
    assert settings["OPENBLAS_NUM_THREADS"] == "1"
    assert "OPENBLAS_CORETYPE" not in settings
    assert "NPY_DISABLE_CPU_FEATURES" not in settings


BOTH = """
from olne_bench.bench.process.arithmetic import arithmetic
from olne_bench.bench.process.child import Child
child = Child()
print(arithmetic(), child.call(arithmetic, kind=str, seconds=60), sep="|")
child.stop()
"""


@pytest.mark.parametrize("off", ["", "X86_V3 AVX2"])
def test_a_parent_names_the_arithmetic_of_its_children(off):
    environment = os.environ | {"NPY_DISABLE_CPU_FEATURES": off}
    run = [sys.executable, "-W", "ignore", "-c", BOTH]
    said = subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout
    here, there = said.strip().split("|")
    assert here == there
    if "OPENBLAS_CORETYPE" in same_arithmetic():
        assert ("held to AVX2" in here) == (not off)


def test_what_is_held_alike_has_one_name(simd):
    names = set()
    for found in (["X86_V3"], ["X86_V3", "X86_V4", "AVX512_ICL"], ["AVX2", "FMA3"]):
        simd(baseline=["X86_V2"], found=found)
        names.add(arithmetic())
    assert len(names) == 1
    for found in ([], ["AVX2"]):
        simd(baseline=["X86_V2"], found=found)
        names.add(arithmetic())
    assert len(names) == 3

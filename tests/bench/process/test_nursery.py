"""The process that forks others: all are its forks, and it passes nothing on."""

import os
import signal
import sys
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest

from olne_bench.bench.process import nursery
from olne_bench.bench.process.child import Child, DiedError

_told = ""


@pytest.fixture
def child() -> Iterator[Child]:
    one = Child(has_children=True)
    yield one
    one.stop()


def keep(text: str) -> int:
    global _told
    _told = text
    return os.getpid()


def what_its_child_knows(restricted: bool) -> str:
    inner = Child(restricted=restricted)
    try:
        return inner.call(kept, kind=str, seconds=20)
    finally:
        inner.stop()


def kept() -> str:
    return _told


def variable(name: str) -> str:
    return os.environ.get(name, "")


def first_variables() -> str:
    """What the system knows of this process's variables, whatever it has changed since."""
    return Path("/proc/self/environ").read_text()


def die_later() -> str:
    os.kill(os.getppid(), signal.SIGKILL)
    signal.pause()
    return ""


def end_by_a_signal() -> str:
    os.kill(os.getpid(), signal.SIGSEGV)
    return ""


def plots_beside_highway() -> list[bool]:
    """Whether plots were there when HighwayEnv was, whether they are found, and whether they work.

    In a process that begins anew.
    """
    import_module("highway_env.envs")
    before = "matplotlib.figure" in sys.modules
    pyplot = import_module("matplotlib.pyplot")
    return [before, find_spec("matplotlib.pyplot") is not None, pyplot.figure().axes == []]


def test_what_highway_env_imports_for_plots_waits_until_it_is_used(child, monkeypatch):
    monkeypatch.setattr(nursery, "_own", None)
    assert child.call(plots_beside_highway, kind=list[bool], seconds=60) == [False, True, True]


def test_processes_are_forks_of_one(child):
    pid = child.call(os.getpid, kind=int, seconds=20)
    other = Child()
    try:
        second = other.call(os.getpid, kind=int, seconds=20)
        assert psutil.Process(pid).ppid() == psutil.Process(second).ppid()
    finally:
        other.stop()
    assert not psutil.pid_exists(second) and psutil.pid_exists(pid)


@pytest.mark.parametrize("restricted", [False, True])
def test_a_process_passes_nothing_on_that_it_was_told(child, restricted):
    child.call(keep, "the truth", kind=int, seconds=20)
    assert child.call(kept, kind=str, seconds=20) == "the truth"
    assert child.call(what_its_child_knows, restricted, kind=str, seconds=40) == ""


def test_variables_are_those_of_the_parent_now_and_a_nursery_never_sees_them(child, monkeypatch):
    monkeypatch.setattr(nursery, "_own", None)
    monkeypatch.setenv("A_SECRET", "of the user")
    monkeypatch.setenv("LC_MONETARY", "C")
    assert child.call(variable, "LC_MONETARY", kind=str, seconds=20) == "C"
    child.end()
    monkeypatch.delenv("LC_MONETARY")
    assert child.call(variable, "LC_MONETARY", kind=str, seconds=20) == ""
    assert child.call(variable, "A_SECRET", kind=str, seconds=20) == "of the user"
    strange = Child(restricted=True)
    try:
        assert strange.call(variable, "A_SECRET", kind=str, seconds=20) == ""
        if Path("/proc/self/environ").exists():
            assert "A_SECRET" not in child.call(first_variables, kind=str, seconds=20)
            assert "A_SECRET" not in strange.call(first_variables, kind=str, seconds=20)
    finally:
        strange.stop()


def test_a_library_that_was_imported_before_does_not_change_how_a_process_ends(monkeypatch, child):
    monkeypatch.setattr(nursery, "_own", None)
    child.modules = ("olne_bench.envs.scenarios.merge",)
    with pytest.raises(DiedError, match="SIGSEGV"):
        child.call(end_by_a_signal, kind=str, seconds=20)


def test_a_nursery_that_is_killed_is_replaced(child, monkeypatch):
    monkeypatch.setattr(nursery, "_own", None)
    first = child.call(os.getpid, kind=int, seconds=20)
    with pytest.raises(DiedError) as caught:
        child.call(die_later, kind=str, seconds=20)
    assert caught.value.outside
    assert child.call(os.getpid, kind=int, seconds=20) != first
    assert not psutil.pid_exists(first) or psutil.Process(first).status() == "zombie"

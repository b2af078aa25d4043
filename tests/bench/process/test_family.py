"""Descendants are found and killed, and their memory is counted."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress

import psutil
import pytest

from olne_bench.bench.process import family

linux = pytest.mark.skipif(sys.platform != "linux", reason="of Linux")
MIB = 2**20
_FAMILY = ["sh -c", "sleep 871", "sleep 872"]


@pytest.fixture
def parent() -> Iterator[subprocess.Popen[str]]:
    """A process with two children, of which one has a child of its own."""
    script = "sleep 871 & sh -c 'sleep 872; :' & echo started; wait"
    process = subprocess.Popen(["sh", "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    deadline = time.monotonic() + 20
    # Until it has replaced itself, a process that starts has its parent's command line.
    while names(process.pid) != _FAMILY and time.monotonic() < deadline:
        time.sleep(0.01)
    below = psutil.Process(process.pid).children(recursive=True)
    yield process
    for one in [*below, process]:
        with suppress(psutil.NoSuchProcess):
            one.kill()
    process.wait()
    process.stdout.close()


def names(pid: int) -> list[str]:
    """What the living descendants of a process do, in words."""
    found = psutil.Process(pid).children(recursive=True)
    alive = [one for one in found if one.status() != psutil.STATUS_ZOMBIE]
    return sorted(" ".join(one.cmdline()[:2]) for one in alive)


def test_descendants_are_seen_while_there_are_any(parent):
    assert names(parent.pid) == _FAMILY
    assert family.has_descendants(parent.pid)
    (leaf,) = [one for one in psutil.Process(parent.pid).children() if one.name() == "sleep"]
    assert not family.has_descendants(leaf.pid)


def test_descendants_are_killed_and_the_process_is_not(parent):
    family.kill_descendants(parent.pid)
    assert names(parent.pid) == []
    parent.wait(20)  # it has no more to wait for
    assert parent.returncode >= 0


@pytest.mark.parametrize("kept", ["sleep", "sh"])
def test_children_are_kept_with_what_is_below_them(parent, kept):
    (child,) = [one for one in psutil.Process(parent.pid).children() if one.name() == kept]
    family.kill_descendants(parent.pid, frozenset([child.pid]))
    assert names(parent.pid) == (["sleep 871"] if kept == "sleep" else ["sh -c", "sleep 872"])


def test_a_family_is_killed_with_its_head(parent):
    below = psutil.Process(parent.pid).children(recursive=True)
    family.kill_family(parent.pid)
    assert parent.wait(20) == -9
    gone, alive = psutil.wait_procs(below, timeout=20)
    assert len(gone) == 3 and not alive


def test_who_is_gone_has_no_descendants_and_holds_nothing(parent):
    family.kill_family(parent.pid)
    parent.wait(20)
    assert not family.has_descendants(parent.pid)
    assert family.held_memory(parent.pid) == 0
    family.kill_family(parent.pid)  # again, without harm
    family.kill_descendants(parent.pid)


@pytest.mark.parametrize(
    ("found", "looks"), [("", 3), ("+", 4), ("-+", 5), ("--+", 6), ("+++-+", 8)]
)
def test_a_search_ends_after_three_looks_in_a_row_without_a_find(monkeypatch, found, looks):
    """``found`` tells look by look whether somebody was there."""
    asked = []

    def below(pid: int, keep: frozenset[int]) -> list[str]:
        asked.append((pid, keep))
        return ["somebody"] if found[len(asked) - 1 : len(asked)] == "+" else []

    monkeypatch.setattr(family, "_below", below)
    monkeypatch.setattr(family, "_kill", bool)
    monkeypatch.setattr(psutil, "wait_procs", lambda *_, **__: None)
    family.kill_descendants(12, frozenset([34]))
    assert asked == [(12, frozenset([34]))] * looks


def test_a_family_that_grows_faster_is_given_up(monkeypatch):
    monkeypatch.setattr(family, "_KILL_SECONDS", 0.2)
    monkeypatch.setattr(family, "_below", lambda *_: [None])
    monkeypatch.setattr(family, "_kill", lambda _: True)
    monkeypatch.setattr(psutil, "wait_procs", lambda *_, **__: None)
    begin = time.monotonic()
    family.kill_descendants(1)
    assert 0.15 < time.monotonic() - begin < 5


def test_the_dead_are_not_killed_again():
    process = subprocess.Popen(["true"])
    one = psutil.Process(process.pid)
    deadline = time.monotonic() + 20
    while one.status() != psutil.STATUS_ZOMBIE and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not family._kill(one)
    assert family.has_descendants(os.getpid())  # nobody has waited for it
    process.wait()


def test_memory_is_that_of_the_process_and_of_all_below_it(parent):
    alone = family.held_memory(parent.pid, descendants=False)
    children = psutil.Process(parent.pid).children(recursive=True)
    each = [family.held_memory(child.pid, descendants=False) for child in children]
    assert min(alone, *each) > 0.1 * MIB
    assert alone == pytest.approx(psutil.Process(parent.pid).memory_info().rss, rel=0.05)
    together = family.held_memory(parent.pid)
    assert together == pytest.approx(alone + sum(each), rel=0.05)


@linux
def test_files_in_memory_count_once_each(tmp_path):
    def files() -> int:
        return sum(family._files_in_memory(os.getpid()).values())

    content = b"x" * 8 * MIB
    before, held = files(), family.held_memory(os.getpid(), descendants=False)
    one, other = os.memfd_create("one"), os.memfd_create("other")
    os.write(one, content)
    os.write(other, memoryview(content)[: 4 * MIB])
    twice = os.dup(one)
    with (tmp_path / "on_disk").open("wb") as file:
        file.write(memoryview(content)[:MIB])
        file.flush()
        assert files() - before == 12 * MIB
        more = family.held_memory(os.getpid(), descendants=False) - held
        assert more == pytest.approx(12 * MIB, abs=3 * MIB)
    for descriptor in (one, other, twice):
        os.close(descriptor)
    assert files() == before
    assert family._files_in_memory(2**22 + 1) == {}  # nobody's number


@linux
def test_a_process_ends_where_its_parent_is_gone_before():
    script = (
        "import os; from olne_bench.bench.process.family import end_with_parent as end; "
        "end(os.getppid()); print('goes on', flush=True); end(os.getpid()); print('not this')"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert (ended.stdout, ended.returncode) == ("goes on\n", 1), ended.stderr


@linux
def test_a_process_ends_with_its_parent():
    child = "import os, time; from olne_bench.bench.process.family import end_with_parent as end; "
    child += "end(os.getppid()); print(os.getpid(), flush=True); time.sleep(100)"
    parent = f"import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', {child!r}]); "
    parent += "time.sleep(100)"
    process = subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    pid = int(process.stdout.readline())
    process.kill()
    process.wait()
    deadline = time.monotonic() + 20
    while psutil.pid_exists(pid) and time.monotonic() < deadline:
        if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
            break
        time.sleep(0.02)
    else:
        assert not psutil.pid_exists(pid)
    process.stdout.close()

"""The fork server: forks are alike, end with their trial, and a server that fails is replaced."""

import _thread
import ctypes
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from pathlib import Path, PurePath
from types import SimpleNamespace

import psutil
import pytest

from olne_bench.bench.process import fork_loop, fork_server, nursery
from olne_bench.bench.process.child import Child, DiedError, LeftProcessesError
from olne_bench.bench.process.family import has_ended
from olne_bench.bench.process.messages import StartError
from olne_bench.bench.process.sandbox import landlock_version


def loaded(name: str) -> bool:
    return name in sys.modules


def parent() -> int:
    return os.getppid()


def end(code: int) -> None:
    os._exit(code)


def write(text: str) -> int:
    print(text)
    return 1


@pytest.fixture
def child():
    one = Child(restricted=True, memory=2**30)
    yield one
    one.stop()


def test_forks_of_one_server_follow_each_other(child):
    server = child.call(parent, kind=int, seconds=5)
    first = child.call(os.getpid, kind=int, seconds=5)
    child.renew()
    second = child.call(os.getpid, kind=int, seconds=5)
    assert first != second
    assert has_ended(first)
    assert child.call(parent, kind=int, seconds=5) == server
    assert psutil.Process(server).children() == [psutil.Process(second)]
    child.stop()
    assert has_ended(server) and has_ended(second)


def test_libraries_are_imported_once(child):
    child.call(loaded, "antigravity", kind=bool, seconds=5)
    child.load(["colorsys", "no_such_module", "olne_bench.errors"])
    assert child.call(loaded, "colorsys", kind=bool, seconds=5)
    assert not child.call(loaded, "no_such_module", kind=bool, seconds=5)


@pytest.fixture(
    params=[
        "import threading, time\nthreading.Thread(target=time.sleep, args=[60]).start()\n",
        "kept = open('/dev/null')\n",
    ]
)
def installed(request):
    """A module among the installed ones."""
    file = Path(sysconfig.get_path("purelib"), f"olne_test_sharing_{os.getpid()}.py")
    file.write_text(request.param)
    yield file.stem
    file.unlink()


def test_a_library_that_forks_would_share_is_left_to_them(child, installed):
    server = child.call(parent, kind=int, seconds=5)
    child.load([installed])
    assert has_ended(server)
    assert not child.call(loaded, installed, kind=bool, seconds=5)
    assert child.call(parent, kind=int, seconds=5) != server


def test_a_server_imports_nothing_that_is_no_library(child, tmp_path, monkeypatch):
    """Names of libraries are a plugin's words."""
    (tmp_path / "mine.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    child.load(["mine"])
    assert not child.call(loaded, "mine", kind=bool, seconds=5)


def test_parts_of_installed_plugins_are_no_libraries(monkeypatch):
    named = SimpleNamespace(group="olne_bench.estimators")
    files = [PurePath("colorsys.py"), PurePath("olne_bench/x.py"), PurePath("two/one.py")]
    found = [SimpleNamespace(entry_points=[named], files=files)]
    monkeypatch.setattr(fork_loop, "distributions", lambda: found)
    for cached in (fork_loop._installed_plugins, fork_loop._is_installed):
        cached.cache_clear()
    assert not fork_loop._is_library("colorsys")
    assert fork_loop._is_library("json.decoder")
    assert not fork_loop._is_library("no_such_module")
    for cached in (fork_loop._installed_plugins, fork_loop._is_installed):
        cached.cache_clear()


def test_a_server_that_is_killed_is_replaced(child):
    server = child.call(parent, kind=int, seconds=5)
    pid = child.call(os.getpid, kind=int, seconds=5)
    child.submit(time.sleep, 60, seconds=60)
    psutil.Process(server).kill()
    with pytest.raises(DiedError) as caught:
        child.wait(int)
    assert caught.value.outside
    assert child.call(parent, kind=int, seconds=5) != server
    assert has_ended(pid)


def test_an_exit_code_is_that_of_the_fork(child):
    with pytest.raises(DiedError, match="died with exit code 7"):
        child.call(end, 7, kind=int, seconds=5)
    assert child.call(write, "still there", kind=int, seconds=5) == 1


def test_a_log_is_cut(child, tmp_path, monkeypatch):
    monkeypatch.setattr(fork_server, "_MOST_LOG", 10)
    log = tmp_path / "log"
    child = Child(restricted=True, log=log)
    try:
        child.call(write, "0123456789abc", kind=int, seconds=5)
    finally:
        child.stop()
    assert log.read_text() == "0123456789\n[4 more bytes]\n"


class _Refusing(list):
    """A search path with which the kernel seems to refuse restrictions."""

    def __repr__(self) -> str:
        refuse = "def restrict(*_): raise OSError('no rules')"
        return (
            f"{sys.path!r}\nimport olne_bench.bench.process.fork_loop as loop\n{refuse}\n"
            "loop.restrict = restrict\nx = 0"
        )


def test_foreign_code_does_not_run_where_the_kernel_refuses(child, monkeypatch):
    monkeypatch.setattr(nursery, "_own", None)
    monkeypatch.setattr(nursery, "search_path", lambda: _Refusing(sys.path))
    with pytest.raises(StartError, match="foreign code cannot be restricted: no rules"):
        child.call(os.getpid, kind=int, seconds=5)


def test_the_folder_of_a_server_goes_with_it(child):
    folder = Path(child.call(os.getcwd, kind=str, seconds=5)).parent
    assert folder.is_dir()
    child.stop()
    assert not folder.exists()


FAST = """
#define _GNU_SOURCE
#include <sched.h>
#include <signal.h>
#include <sys/syscall.h>
#include <unistd.h>
static char stacks[2][8192] __attribute__((aligned(64)));
static int step(void *turn) {
    long next = 1 - (long)turn;
    clone(step, stacks[next] + 8000, CLONE_VM | SIGCHLD, (void *)next);
    syscall(SYS_exit, 0);
    return 0;
}
void start(void) {
    if (fork()) return;
    clone(step, stacks[0] + 8000, CLONE_VM | SIGCHLD, (void *)0);
    _exit(0);
}
"""


def start_fast_chain() -> int:
    """Start a process that forks and ends, for ever, thousands of times a second."""
    Path("fast.c").write_text(FAST)
    subprocess.run(["cc", "-shared", "-fPIC", "-o", "fast.so", "fast.c"], check=True)
    ctypes.CDLL(os.path.abspath("fast.so")).start()  # noqa: PTH100
    return 1


@pytest.mark.skipif(landlock_version() < 6 or not shutil.which("cc"), reason="needs Linux 6.12")
def test_a_family_that_forks_faster_than_it_is_found_ends(child):
    server = child.call(parent, kind=int, seconds=5)
    with pytest.raises(LeftProcessesError):
        child.call(start_fast_chain, kind=int, seconds=30)
    began = time.monotonic()
    pid = child.call(os.getpid, kind=int, seconds=60)
    assert time.monotonic() - began < 20
    assert psutil.Process(server).children(recursive=True) == [psutil.Process(pid)]


def work_on() -> int:
    """Start a thread that works, in a way that ``threading`` does not know of."""

    def work() -> None:
        while True:
            pass

    _thread.start_new_thread(work, ())
    return 1


def test_no_thread_works_between_two_pieces_of_work(child):
    child.call(work_on, kind=int, seconds=5)
    before = child.call(time.process_time, kind=float, seconds=5)
    time.sleep(1.0)
    assert child.call(time.process_time, kind=float, seconds=5) - before < 0.5


def test_a_server_has_one_thread(child):
    server = child.call(parent, kind=int, seconds=5)
    assert psutil.Process(server).num_threads() == 1


def starts_another() -> str:
    """What a process in a sandbox of its own answers, and whether it can read what this one can."""
    inner = Child(restricted=True, memory=2**30)
    try:
        pids = [inner.call(os.getpid, kind=int, seconds=60)]
        inner.renew()
        pids.append(inner.call(os.getpid, kind=int, seconds=60))
        return "others" if len({*pids, os.getpid()}) == 3 else "the same"
    finally:
        inner.stop()


def test_a_sandbox_may_hold_another():
    """As that of a foreign scenario's referee, whose metrics and estimators are foreign, too."""
    child = Child(restricted=True, memory=2**31, has_children=True)
    try:
        assert child.call(starts_another, kind=str, seconds=120) == "others"
    finally:
        child.stop()

"""Child processes: the parent always gets an answer or a reason, and no process is left."""

import os
import shutil
import signal
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pytest

from olne_bench.bench.process import inside, nursery
from olne_bench.bench.process.child import (
    Child,
    DiedError,
    LeftProcessesError,
    MisspokeError,
    OutOfMemoryError,
    RaisedError,
    TimedOutError,
    _cause,
    _raise,
    _too_much,
)
from olne_bench.bench.process.messages import Raised, Ready, Stage, StartError, encode
from olne_bench.bench.process.nursery import search_path
from olne_bench.errors import UserError

SLEEPER = f"4321.5{os.getpid()}"  # tests run beside each other and tell their own by it


def add(a: float, b: float) -> float:
    return a + b


def raise_it(error: BaseException) -> None:
    raise error


def sleep(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def end(code: int) -> None:
    os._exit(code)


def kill_itself(number: int) -> None:
    os.kill(os.getpid(), number)


def hoard() -> None:
    kept = []
    while True:
        kept.append(np.ones(2**22))


SLEEP = "import time; time.sleep(float({0!r}))"


def sleeper() -> list[str]:
    """A command that sleeps: a sandbox runs Python, and no other program."""
    return [sys.executable, "-c", SLEEP.format(SLEEPER), SLEEPER]


def run_apart(*command: str) -> int:
    return subprocess.run(command, start_new_session=True, check=False).returncode


def leave_a_process(*command: str) -> int:
    return subprocess.Popen(command, start_new_session=True).pid


def leave_processes(forks: int, *command: str) -> int:
    """Leave two processes whose parents have ended, in sessions of their own."""
    for _ in range(2):
        if (pid := os.fork()) == 0:
            for _ in range(forks):
                os.setsid()
                if os.fork():
                    os._exit(0)
            os.execv(command[0], command)
        if forks:
            os.waitpid(pid, 0)
    time.sleep(0.2)
    return 1


def leave_a_thread() -> float:
    threading.Timer(1.0, os._exit, [5]).start()
    return 1.0


def own_socket() -> socket.socket:
    """The connection to the parent, as foreign code would find it."""
    for number in range(3, 100):
        with suppress(OSError):
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                return socket.socket(fileno=os.dup(number))
    raise AssertionError("no socket")


def write(content: bytes) -> float:
    own_socket().sendall(content)
    time.sleep(0.3)
    return 1.0


def two_stages() -> float:
    for name in ("first", "second"):
        inside.announce(name, 5.0)
        time.sleep(0.6)
    return 2.0


def announce_and_sleep() -> None:
    inside.announce("scoring", 0.5)
    time.sleep(60)


def directory() -> str:
    return str(Path.cwd())


def hold(number: int) -> float:
    global _held
    _held = np.ones(number)
    return 1.0


def frame(content: bytes) -> bytes:
    return struct.pack("!I", len(content)) + content


@pytest.fixture
def child():
    one = Child(restricted=True, memory=2**30)
    yield one
    one.stop()


def sleepers() -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter(["cmdline"]):
        if SLEEPER in (process.info["cmdline"] or []):
            found.append(process)
    return found


def left_sleepers() -> list[psutil.Process]:
    """Sleepers that still run after a short time, in which they may be ended."""
    deadline = time.monotonic() + 5
    while (found := sleepers()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return found


def wait_for_sleepers(count: int) -> None:
    """Wait until so many sleepers run. A process has no command line while it starts."""
    deadline = time.monotonic() + 30
    while len(sleepers()) < count and time.monotonic() < deadline:
        time.sleep(0.1)


def test_work_is_done_again_and_again_in_one_process(child):
    assert child.call(add, 1.0, 2.0, kind=float, seconds=5) == 3.0
    first = child.call(os.getpid, kind=int, seconds=5)
    assert child.call(os.getpid, kind=int, seconds=5) == first
    assert child.served == 3


def test_what_raises_is_told_in_one_line_and_the_process_lives_on(child):
    with pytest.raises(RaisedError, match=r"^ValueError: no idea \(.*test_child.py:\d+\)$"):
        child.call(raise_it, ValueError("no\nidea"), kind=float, seconds=5)
    with pytest.raises(UserError, match=r"^bad input$"):
        child.call(raise_it, UserError("bad\ninput"), kind=float, seconds=5)
    with pytest.raises(RaisedError, match="SystemExit: 3"):
        child.call(raise_it, SystemExit(3), kind=float, seconds=5)
    with pytest.raises(RaisedError, match="KeyboardInterrupt"):
        child.call(raise_it, KeyboardInterrupt(), kind=float, seconds=5)
    assert child.served == 4


def test_messages_are_short(child):
    with pytest.raises(RaisedError) as caught:
        child.call(raise_it, ValueError("x" * 30_000_000), kind=float, seconds=20)
    assert len(str(caught.value)) <= 1000


def test_the_limit_is_kept(child):
    child.call(add, 1.0, 2.0, kind=float, seconds=5)
    started = time.monotonic()
    with pytest.raises(TimedOutError):
        child.call(sleep, 60.0, kind=float, seconds=0.5)
    assert time.monotonic() - started < 5
    assert child.call(add, 1.0, 2.0, kind=float, seconds=5) == 3.0


@pytest.mark.parametrize(
    ("function", "argument", "cause"),
    [
        (end, 0, "the process died with exit code 0"),
        (end, 7, "the process died with exit code 7"),
        (kill_itself, signal.SIGSEGV, r"the process was killed by SIGSEGV \(signal 11\)"),
    ],
)
def test_a_death_has_a_cause(child, function, argument, cause):
    with pytest.raises(DiedError, match=f"^{cause}$") as caught:
        child.call(function, argument, kind=float, seconds=5)
    assert not caught.value.outside and caught.value.served == 0


def test_a_death_after_other_work_says_so(child):
    child.call(add, 1.0, 2.0, kind=float, seconds=5)
    with pytest.raises(DiedError) as caught:
        child.call(end, 7, kind=float, seconds=5)
    assert caught.value.served == 1 and not caught.value.outside


def test_what_a_process_says_just_before_its_end_counts(child, monkeypatch):
    """It starts, works and dies between the look at its messages and that at itself."""
    child.submit(end, 3, seconds=60)
    ended = child._process.ended

    def ended_by_now() -> bool:
        while not ended():
            time.sleep(0.01)
        return True

    monkeypatch.setattr(child._process, "ended", ended_by_now)
    with pytest.raises(DiedError, match=r"^the process died with exit code 3$"):
        child.wait(float)


def test_a_kill_from_outside_says_so(child):
    with pytest.raises(DiedError) as caught:
        child.call(kill_itself, signal.SIGKILL, kind=float, seconds=5)
    assert caught.value.outside


def test_memory_has_a_limit(child):
    with pytest.raises(OutOfMemoryError, match="out of memory, the limit is 1 GiB"):
        child.call(hoard, kind=float, seconds=60)


@pytest.mark.parametrize(
    "content",
    [
        b"\xff\xff\xff\xff",
        frame(b"garbage"),
        frame(encode(Ready())),
        frame(encode(Stage("for ever", 1e9))),
        frame(b"\x82\xa4type\xa6result\xa5token\x01"),
    ],
)
def test_a_forged_message_ends_the_work_and_nothing_else(child, content):
    with pytest.raises(MisspokeError):
        child.call(write, content, kind=float, seconds=10)
    assert child.call(add, 1.0, 2.0, kind=float, seconds=5) == 3.0


def test_half_a_message_runs_into_the_limit(child):
    child.call(add, 1.0, 2.0, kind=float, seconds=5)
    with pytest.raises((TimedOutError, MisspokeError)):
        child.call(write, b"\0\0\0\x50half", kind=float, seconds=1.5)


def test_an_answer_in_advance_is_not_taken_for_the_next(child):
    child.call(add, 1.0, 2.0, kind=float, seconds=5)
    pid = child.call(os.getpid, kind=int, seconds=5)
    os.kill(pid, 0)
    child.submit(leave_a_message_behind, seconds=5)
    child.wait(float)
    time.sleep(0.5)
    assert child.call(add, 1.0, 2.0, kind=float, seconds=5) == 3.0
    assert child.call(os.getpid, kind=int, seconds=5) != pid


def leave_a_message_behind() -> float:
    sender = own_socket()
    threading.Timer(0.2, sender.sendall, [frame(encode(Ready()))]).start()
    return 1.0


def test_processes_that_are_left_end(child):
    with pytest.raises(LeftProcessesError):
        child.call(leave_a_process, *sleeper(), kind=int, seconds=5)
    assert not left_sleepers()


@pytest.mark.parametrize("forks", [0, 1, 2])
def test_processes_that_leave_session_and_parent_end(child, forks):
    with pytest.raises(LeftProcessesError):
        child.call(leave_processes, forks, *sleeper(), kind=int, seconds=5)
    assert not left_sleepers()


def test_descendants_end_with_a_time_limit(child):
    child.call(add, 1.0, 2.0, kind=float, seconds=5)
    with pytest.raises(TimedOutError):
        child.call(run_apart, *sleeper(), kind=int, seconds=1)
    assert not left_sleepers()


def test_descendants_end_with_the_driver(tmp_path):
    script = tmp_path / "driver.py"
    script.write_text(
        "from olne_bench.bench.process.child import Child\n"
        "import subprocess, sys, time\n"
        "child = Child(restricted=True)\n"
        f"command = {sleeper()!r}\n"
        "code = 'import os, subprocess; os.setsid()\\n'\n"
        "code += f'for _ in range(2): subprocess.Popen({command!r})'\n"
        "twice = f'import subprocess\\n'\n"
        "twice += f'subprocess.Popen([{sys.executable!r}, \"-c\", {code!r}])\\n'\n"
        "twice += f'subprocess.run({command!r})'\n"
        "child.submit(exec, twice, seconds=1000)\n"
        "while child.channel.poll() is None: time.sleep(0.05)\n"
        "print('started', flush=True)\n"
        "time.sleep(1000)\n"
    )
    driver = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    assert driver.stdout is not None
    driver.stdout.readline()
    deadline = time.monotonic() + 30
    wait_for_sleepers(3)
    assert len(sleepers()) >= 3
    driver.kill()
    driver.wait()
    driver.stdout.close()
    while sleepers() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not left_sleepers()


def test_a_thread_that_is_left_costs_the_process(child):
    first = child.call(os.getpid, kind=int, seconds=5)
    child.call(leave_a_thread, kind=float, seconds=5)
    assert child.call(os.getpid, kind=int, seconds=5) != first


def test_memory_that_is_kept_costs_the_process(child):
    first = child.call(os.getpid, kind=int, seconds=5)
    child.call(hold, 2**26 + 2**24, kind=float, seconds=10)
    assert child.call(os.getpid, kind=int, seconds=5) != first


def test_stages_have_limits_of_their_own_where_they_are_allowed():
    child = Child(may_announce=True)
    try:
        assert child.call(two_stages, kind=float, seconds=0.5) == 2.0
        with pytest.raises(TimedOutError, match="scoring"):
            child.call(announce_and_sleep, kind=float, seconds=10)
    finally:
        child.stop()


def test_a_restricted_child_has_a_folder_of_its_own(child):
    folder = child.call(directory, kind=str, seconds=5)
    assert Path(folder).is_dir()
    assert folder != str(Path.cwd())
    child.stop()
    assert not Path(folder).exists()


def test_the_cause_of_a_death_is_named():
    assert _cause(3) == "died with exit code 3"
    assert _cause(-signal.SIGKILL) == "was killed by SIGKILL (signal 9)"
    assert _cause(-99) == "was killed by signal 99"


def test_only_who_has_asked_adopts_orphans():
    script = "from olne_bench.bench.process.family import *; print(adopts_orphans()); "
    script += "adopt_orphans(); print(adopts_orphans())"
    said = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert said.stdout.split() == ["False", str(sys.platform == "linux")]


def numbers_of_threads() -> list[str]:
    return [os.environ[f"{name}_NUM_THREADS"] for name in ("OMP", "OPENBLAS", "MKL")]


def say(text: str) -> float:
    print(text)
    return 1.0


def folder_for_files() -> str:
    return tempfile.gettempdir()


def test_processes_compute_in_one_thread_and_have_a_folder_for_files(child):
    assert child.call(numbers_of_threads, kind=list[str], seconds=5) == ["1"] * 3
    assert child.call(folder_for_files, kind=str, seconds=5) == child.call(
        directory, kind=str, seconds=5
    )


def test_what_is_printed_is_added_to_the_log(tmp_path):
    log = tmp_path / "log"
    log.write_text("before\n")
    for text in ("first", "second"):
        child = Child(log=log)
        child.call(say, text, kind=float, seconds=5)
        child.stop()
    assert log.read_text() == "before\nfirst\nsecond\n"


def test_who_is_trusted_stays_here_and_may_leave_processes():
    child = Child()
    try:
        assert child.call(directory, kind=str, seconds=5) == str(Path.cwd())
        child.call(leave_a_process, *sleeper(), kind=int, seconds=5)
        wait_for_sleepers(1)
        assert len(sleepers()) == 1
        assert (child.busy, child.served) == (False, 2)
    finally:
        child.stop()
    assert not left_sleepers()
    assert (child.busy, child.served) == (False, 0)


def test_a_parent_of_children_may_have_some_left():
    child = Child(restricted=True, has_children=True)
    try:
        child.call(leave_a_process, *sleeper(), kind=int, seconds=5)
        wait_for_sleepers(1)
        assert len(sleepers()) == 1
    finally:
        child.stop()
    assert not left_sleepers()


def test_who_had_too_little_memory_is_replaced():
    child = Child(memory=2**30)
    try:
        with pytest.raises(OutOfMemoryError, match="the limit is 1 GiB: MemoryError: much"):
            child.call(raise_it, MemoryError("much"), kind=float, seconds=5)
        assert child.served == 0
    finally:
        child.stop()


def test_a_memory_error_without_a_limit_is_one_like_others():
    with pytest.raises(RaisedError, match="much"):
        _raise(Raised(1, "memory", "much"), None)
    with pytest.raises(OutOfMemoryError, match="2 GiB: much"):
        _raise(Raised(1, "memory", "much"), 2**31)
    with pytest.raises(RaisedError, match="other"):
        _raise(Raised(1, "other", "other"), 2**31)


def test_a_machine_on_which_nothing_starts_is_told(monkeypatch):
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    monkeypatch.setattr(nursery, "_own", None)
    child = Child()
    with pytest.raises(DiedError, match="a process died with exit code 1 before") as caught:
        child.call(add, 1.0, 2.0, kind=float, seconds=5)
    assert caught.value.outside
    assert not child.busy


def test_a_start_has_a_limit_of_its_own(monkeypatch, tmp_path):
    child = Child()
    assert child.call(add, 1.0, 2.0, kind=float, seconds=0.3) == 3.0  # which starting is no part of
    child.stop()
    slow = tmp_path / "python"
    slow.write_text("#!/bin/sh\nexec sleep 30\n")
    slow.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(slow))
    monkeypatch.setattr(nursery, "_own", None)
    monkeypatch.setattr("olne_bench.bench.process.child.START_LIMIT", 0.05)
    with pytest.raises(StartError, match=r"did not start within 0\.05 s"):
        child.call(add, 1.0, 2.0, kind=float, seconds=5)
    assert not child.busy


def test_a_search_path_leads_to_the_same_places_from_anywhere(monkeypatch):
    monkeypatch.setattr(sys, "path", ["", "/usr/lib", ".", "relative"])
    here = str(Path.cwd())
    assert search_path() == [here, "/usr/lib", here, "relative"]


def test_sizes_are_told_in_gib():
    assert _too_much(3 * 2**29, "so it is") == "out of memory, the limit is 1.5 GiB: so it is"


def test_an_exit_without_an_error_is_no_signal():
    assert _cause(0) == "died with exit code 0"
    assert _cause(-1) == "was killed by SIGHUP (signal 1)"

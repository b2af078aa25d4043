"""The sandbox: what foreign code can reach, and what it cannot."""

import os
import socket
import sys
from pathlib import Path

import pytest

from olne_bench.bench.process import sandbox
from olne_bench.bench.process.child import Child, RaisedError
from olne_bench.bench.process.sandbox import landlock_version, restrictions

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or landlock_version() < 6, reason="needs Landlock, Linux 6.12 or later"
)


def read(path: str) -> str:
    return Path(path).read_text()


def write(path: str) -> int:
    return Path(path).write_text("x")


def target(path: str) -> str:
    return str(Path(path).readlink())


def connect(port: int) -> int:
    with socket.create_connection(("127.0.0.1", port), timeout=5):
        return port


def signal_to(pid: int) -> int:
    os.kill(pid, 0)
    return pid


@pytest.fixture
def hidden(tmp_path):
    folder = tmp_path / "runs" / "one"
    folder.mkdir(parents=True)
    (folder / "secret").write_text("salt")
    (tmp_path / "data").write_text("open")
    (tmp_path / "runs" / "notes").write_text("open")
    (tmp_path / "link").symlink_to(folder)
    return folder


@pytest.fixture
def child(hidden):
    one = Child(restricted=True, hidden=hidden)
    yield one
    one.stop()


def test_the_hidden_folder_cannot_be_read_and_others_can(child, hidden):
    above = hidden.parent.parent
    for path in (above / "data", above / "runs" / "notes", "/etc/hostname", __file__):
        assert child.call(read, str(path), kind=str, seconds=5)
    for path in (hidden / "secret", above / "link" / "secret"):
        with pytest.raises(RaisedError, match="PermissionError"):
            child.call(read, str(path), kind=str, seconds=5)


def test_draws_that_the_user_played_cannot_be_read(monkeypatch, tmp_path):
    """They hold true motions. This holds without a hidden run, and before the first is kept."""
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(tmp_path / "cache"))
    draws = tmp_path / "cache-draws"
    (tmp_path / "data").write_text("open")
    one = Child(restricted=True)
    try:
        assert one.call(read, str(tmp_path / "data"), kind=str, seconds=5) == "open"
        draws.mkdir()
        (draws / "a.npz").write_text("truth")
        with pytest.raises(RaisedError, match="PermissionError"):
            one.call(read, str(draws / "a.npz"), kind=str, seconds=5)
    finally:
        one.stop()


def test_nothing_is_written_outside_of_its_own_folder(child, hidden):
    assert child.call(write, "own", kind=int, seconds=5) == 1
    for path in (hidden / "new", hidden.parent.parent / "data", "/var/tmp/olne_bench_test"):
        with pytest.raises(RaisedError, match="PermissionError"):
            child.call(write, str(path), kind=int, seconds=5)
    assert (hidden.parent.parent / "data").read_text() == "open"


def test_no_process_outside_is_signalled_or_looked_into(child):
    with pytest.raises(RaisedError, match="PermissionError"):
        child.call(signal_to, os.getpid(), kind=int, seconds=5)
    for name in ("environ", "maps"):
        with pytest.raises(RaisedError, match="PermissionError"):
            child.call(read, f"/proc/{os.getpid()}/{name}", kind=str, seconds=5)
    with pytest.raises(RaisedError, match="PermissionError"):
        child.call(target, f"/proc/{os.getpid()}/fd/0", kind=str, seconds=5)


def test_no_connection_is_opened(child):
    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        pytest.raises(RaisedError, match="PermissionError"),
    ):
        child.call(connect, server.getsockname()[1], kind=int, seconds=10)


def test_a_folder_that_is_made_later_is_hidden_as_well(tmp_path):
    late = tmp_path / "runs" / "late"
    child = Child(restricted=True, hidden=late)
    try:
        child.call(write, "own", kind=int, seconds=5)
        late.mkdir(parents=True)
        (late / "secret").write_text("salt")
        with pytest.raises(RaisedError, match="PermissionError"):
            child.call(read, str(late / "secret"), kind=str, seconds=5)
    finally:
        child.stop()


def test_what_is_kept_from_foreign_code_can_be_told():
    assert "the run folder" in restrictions()
    assert "signals to other processes" in restrictions()


class Kernel:
    """Record what a process asks of a kernel with some version of Landlock."""

    def __init__(self, version: int) -> None:
        self.version, self.calls = version, []
        self.rights: tuple[int, ...] = ()
        self.size = 0
        self.rules: dict[str, int] = {}

    def syscall(self, number: int, *arguments) -> int:
        self.calls.append(number)
        if number == 444 and arguments[0] is None:
            assert arguments == (None, 0, 1)  # asks for the version
            return self.version
        if number == 444:
            asked = arguments[0]._obj
            self.rights, self.size = (asked.fs, asked.net, asked.scoped), arguments[1]
            assert arguments[2] == 0
            return os.open("/dev/null", os.O_RDONLY)
        if number == 445:
            assert arguments[1] == 1 and arguments[3] == 0
            rule = arguments[2]._obj
            place = os.readlink(f"/proc/self/fd/{rule.parent}")  # noqa: PTH115
            self.rules[place] = self.rules.get(place, 0) | rule.allowed
            return 0
        assert number == 446 and arguments[1] == 0
        return 0

    def prctl(self, *arguments: int) -> int:
        assert arguments == (38, 1, 0, 0, 0)
        self.calls.append(38)
        return 0

    def capset(self, header, data) -> int:
        assert (header._obj.version, header._obj.pid) == (0x20080522, 0)
        assert bytes(data) == bytes(24)
        return 0


#: By version: all rights on files, on TCP, on signals and sockets, and the size of the question.
LANDLOCK = {
    1: (13, 0, 0, 8),
    2: (14, 0, 0, 8),
    3: (15, 0, 0, 8),
    4: (15, 3, 0, 16),
    5: (16, 3, 0, 16),
    6: (16, 3, 3, 24),
    9: (16, 3, 3, 24),
}


@pytest.mark.parametrize("version", LANDLOCK)
def test_every_kernel_is_asked_for_all_that_it_knows(version, hidden, tmp_path, monkeypatch):
    kernel = Kernel(version)
    monkeypatch.setattr(sandbox, "_libc", lambda: kernel)
    own = tmp_path / "own"
    own.mkdir()
    sandbox.restrict([hidden], own)
    bits, net, scoped, size = LANDLOCK[version]
    every = 2**bits - 1
    assert kernel.rights == (every, net, scoped)
    assert kernel.size == size
    assert kernel.calls[-2:] == [38, 446]  # no new privileges, then no way back
    # Everything can be listed at the top; read, executed and listed beside what is hidden.
    assert kernel.rules["/"] == 8
    assert str(hidden) not in kernel.rules
    assert not any(hidden.is_relative_to(p) and r & 4 for p, r in kernel.rules.items())
    assert kernel.rules[str(tmp_path / "data")] == 1 | 4  # a file: no listing
    assert kernel.rules[str(own)] == every
    assert kernel.rules["/dev/null"] == every & (1 | 2 | 4 | 2**14 | 2**15)
    told = ["the run folder", "writing outside of its folder"]
    told += ["TCP connections"] * (version >= 4) + ["signals to other processes"] * (version >= 6)
    assert restrictions() == tuple(told)


def test_without_landlock_nothing_is_restricted(tmp_path, monkeypatch):
    kernel = Kernel(-1)
    monkeypatch.setattr(sandbox, "_libc", lambda: kernel)
    assert landlock_version() == 0
    sandbox.restrict([], tmp_path)
    assert set(kernel.calls) == {444}
    assert not kernel.rules and restrictions() == ()

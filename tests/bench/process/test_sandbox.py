"""The sandbox: what foreign code reaches, and what it does not."""

import os
import socket
import sys
from pathlib import Path

import pytest

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
    """They hold true motions; also where no run is hidden, and before the first is kept."""
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

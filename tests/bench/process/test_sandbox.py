"""The sandbox: what foreign code can reach, and what it cannot."""

import ctypes
import errno
import fcntl
import mmap
import os
import platform
import resource
import shutil
import signal
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from olne_bench.bench.process import sandbox
from olne_bench.bench.process.child import Child, RaisedError
from olne_bench.bench.process.sandbox import landlock_version, restrictions
from olne_bench.bench.process.system_calls import _LOCKING, _REFUSED, _WITHOUT_EFFECT
from olne_bench.envs.solved import shipped_draws

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or landlock_version() < 6, reason="needs Landlock, Linux 6.12 or later"
)


def read(path: str) -> str:
    return Path(path).read_text()


def write(path: str) -> int:
    return Path(path).write_text("x")


def target(path: str) -> str:
    return str(Path(path).readlink())


def directory() -> str:
    return str(Path.cwd())


def connect(port: int) -> int:
    with socket.create_connection(("127.0.0.1", port), timeout=5):
        return port


def signal_to(pid: int) -> int:
    os.kill(pid, 0)
    return pid


def from_every_thread(path: str) -> list[str]:
    """How all threads of this process are restricted, and what reading a file gives each."""
    said = []

    def look() -> None:
        try:
            said.append(Path(path).read_text())
        except OSError as error:
            said.append(type(error).__name__)

    threads = [threading.Thread(target=look) for _ in range(2)]
    for thread in threads:
        thread.start()
    look()
    for thread in threads:
        thread.join()
    keys = ("CapEff", "CapPrm", "CapBnd", "NoNewPrivs", "Seccomp")
    for status in Path("/proc/self/task").glob("*/status"):
        fields = dict(line.split(":\t") for line in status.read_text().splitlines())
        said.append(" ".join(fields[key].strip() for key in keys))
    return sorted(set(said))


def run(*command: str) -> int:
    return subprocess.run(command, check=False, capture_output=True).returncode


def call(name: str, *arguments: int) -> int:
    """A system call by its number; its result, or the negative number of its error."""
    numbers = {**_REFUSED, **_WITHOUT_EFFECT, **_LOCKING}[name]
    number = numbers[["x86_64", "aarch64"].index(platform.machine())]
    libc = ctypes.CDLL(None, use_errno=True)
    result = libc.syscall(number, *arguments)
    return -ctypes.get_errno() if result < 0 else result


def environment() -> dict[str, str]:
    return dict(os.environ)


def command_lines() -> str:
    return " ".join(path.read_text() for path in Path("/proc/self").glob("cmdline"))


def others() -> list[str]:
    """Processes that can be seen in /proc beside this one."""
    seen = []
    for place in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            place.read_text()
            seen.append(place.parent.name)
    return [name for name in seen if name != str(os.getpid())]


def say(text: str) -> int:
    print(text)
    return 1


def cut_the_log() -> int:
    os.ftruncate(1, 0)
    return len(os.read(os.open("/proc/self/fd/1", os.O_RDONLY), 100))


def lock(path: str) -> int:
    with Path(path).open() as file:
        try:
            fcntl.lockf(file, fcntl.LOCK_SH)
        except OSError as error:
            return error.errno or 0
    return 0


@pytest.fixture
def hidden(tmp_path):
    folder = tmp_path / "runs" / "one"
    folder.mkdir(parents=True)
    (folder / "secret").write_text("salt")
    (tmp_path / "data").write_text("open")
    (tmp_path / "suite.draws").write_text("truth")
    (tmp_path / "runs" / "notes").write_text("other work")
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "object").write_text("draws")
    (tmp_path / "helpers").mkdir()
    (tmp_path / "helpers" / "one.py").write_text("x = 1")
    (tmp_path / "plugin_data").mkdir()
    (tmp_path / "plugin_data" / "network").write_text("open")
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins" / "other").write_text("another's")
    (tmp_path / "plugin.py").write_text("")
    (tmp_path / "link").symlink_to(folder)
    (tmp_path / "note").symlink_to(tmp_path / "runs" / "notes")
    (tmp_path / "plugin_all").symlink_to("/")
    return folder


@pytest.fixture
def child(hidden):
    one = Child(restricted=True, plugins=[f"{hidden.parents[1]}/plugin.py:Any"], hidden=hidden)
    yield one
    one.stop()


def refuses(child: Child, function, *arguments, kind=str) -> None:
    with pytest.raises(RaisedError, match="PermissionError"):
        child.call(function, *arguments, kind=kind, seconds=10)


def test_files_are_read_by_a_list(child, hidden):
    home = hidden.parents[1]
    beside = ("data", "plugin.py", "helpers/one.py", "plugin_data/network")
    for path in (*(home / name for name in beside), os.__file__, np.__file__, __file__):
        child.call(read, str(path), kind=str, seconds=5)
    secret = ["runs/one/secret", "link/secret", "runs/notes", ".git/object", "suite.draws"]
    secret += ["note", "plugin_all/etc/shadow", "plugins/other"]
    for path in (*(home / name for name in secret), "/etc/shadow", "/etc/hostname"):
        refuses(child, read, str(path))


def test_neither_solved_draws_nor_other_copies_of_this_package_are_read(child, tmp_path):
    copy = tmp_path.parent / f"{tmp_path.name}-copy"
    shutil.copytree(shipped_draws(), copy)
    for folder in (shipped_draws(), copy):
        files = [*folder.glob("*.draws")]
        assert len(files) == 2
        for draws in files:
            refuses(child, read, str(draws))
    assert child.call(read, str(shipped_draws().parent / "kept_draws.py"), kind=str, seconds=5)


def test_draws_that_the_user_played_cannot_be_read(monkeypatch, tmp_path):
    """They hold true motions, whether they were kept before or after the start."""
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(tmp_path / "cache"))
    (tmp_path / "plugin.py").write_text("")
    draws = tmp_path / "cache-draws"
    one = Child(restricted=True, plugins=[str(tmp_path / "plugin.py")])
    try:
        assert one.call(read, str(tmp_path / "plugin.py"), kind=str, seconds=5) == ""
        draws.mkdir()
        (draws / "a.npz").write_text("truth")
        refuses(one, read, str(draws / "a.npz"))
    finally:
        one.stop()


def test_every_thread_is_restricted(child, hidden):
    said = child.call(from_every_thread, str(hidden / "secret"), kind=list[str], seconds=5)
    assert said == ["0000000000000000 " * 3 + "1 2", "PermissionError"]


def test_nothing_is_written_outside_of_its_own_folder(child, hidden):
    assert child.call(write, "own", kind=int, seconds=5) == 1
    outside = (hidden / "new", hidden.parents[1] / "data", "/var/tmp/olne_bench_test")
    for path in (*outside, "/dev/shm/olne_bench_test", "/dev/tty", "../beside"):
        refuses(child, write, str(path), kind=int)
    assert (hidden.parents[1] / "data").read_text() == "open"


def test_nothing_that_was_written_is_there_for_the_next_process(child):
    child.call(write, "own", kind=int, seconds=5)
    first = child.call(directory, kind=str, seconds=5)
    child.renew()
    second = child.call(directory, kind=str, seconds=5)
    assert first != second
    with pytest.raises(RaisedError, match="FileNotFoundError"):
        child.call(read, "own", kind=str, seconds=5)
    assert not Path(first).exists()


def test_programs_are_run_by_a_list(child):
    assert child.call(run, sys.executable, "-c", "", kind=int, seconds=30) == 0
    assert child.call(run, shutil.which("cc") or "", "--version", kind=int, seconds=30) == 0
    for program in ("sh", "sleep", "git"):
        refuses(child, run, shutil.which(program), "--version", kind=int)


def test_a_compiler_works(child):
    source = "int three(void) { return 3; }"
    assert child.call(write_and_compile, source, kind=int, seconds=60) == 3


def write_and_compile(source: str) -> int:
    Path("source.c").write_text(source)
    subprocess.run(["cc", "-shared", "-fPIC", "source.c", "-o", "library.so"], check=True)
    return int(ctypes.CDLL(str(Path("library.so").resolve())).three())


def test_no_process_outside_is_signalled_or_looked_into(child):
    refuses(child, signal_to, os.getpid(), kind=int)
    for name in ("environ", "maps", "cmdline"):
        refuses(child, read, f"/proc/{os.getpid()}/{name}")
    refuses(child, target, f"/proc/{os.getpid()}/fd/0")
    assert child.call(others, kind=list[str], seconds=5) == []


def test_neither_variables_nor_the_command_line_tell_what_a_process_is_for(monkeypatch, tmp_path):
    monkeypatch.setenv("TELLING", "verify")
    monkeypatch.chdir(tmp_path)
    child = Child(restricted=True, hidden=tmp_path / "verified")
    try:
        told = child.call(environment, kind=dict[str, str], seconds=5)
        said = child.call(command_lines, kind=str, seconds=5)
    finally:
        child.stop()
    assert "TELLING" not in told and "verif" not in f"{said} {told}"


def test_no_connection_is_opened(child):
    with socket.create_server(("127.0.0.1", 0)) as server:
        refuses(child, connect, server.getsockname()[1], kind=int)


@pytest.mark.parametrize("name", [*_REFUSED, *_LOCKING])
def test_calls_that_lead_to_other_processes_are_refused(child, name):
    numbers = {**_REFUSED, **_LOCKING}[name]
    if numbers[["x86_64", "aarch64"].index(platform.machine())] is None:
        return  # this machine has no such call
    expected = errno.ENOLCK if name in _LOCKING else errno.EACCES
    assert child.call(call, name, 0, 0, 0, 0, kind=int, seconds=5) == -expected


def connect_or_tell(kind: int) -> int:
    with suppress(OSError):
        first, _ = socket.socketpair(type=kind)
        first.sendto(b"x", "/nowhere")
        return 0
    return 1


def limit_of_parent() -> int:
    return resource.prlimit(os.getppid(), resource.RLIMIT_CPU, (1, 1))[0]


def new_user() -> int:
    """A child in a new user namespace."""
    return os.waitpid(_clone(0x10000000 | signal.SIGCHLD), 0)[0]


def brother() -> int:
    """A child of this process's parent."""
    return _clone(0x8000 | signal.SIGCHLD)


def _clone(flags: int) -> int:
    number = {"x86_64": 56, "aarch64": 220}[platform.machine()]
    libc = ctypes.CDLL(None, use_errno=True)
    pid = libc.syscall(number, flags, 0, 0, 0, 0)
    if pid == 0:
        os._exit(0)
    if pid < 0:
        raise PermissionError(os.strerror(ctypes.get_errno()))
    return int(pid)


def shared_memory() -> int:
    return len(mmap.mmap(-1, 4096))


@pytest.mark.parametrize("function", [limit_of_parent, new_user, brother, shared_memory])
def test_no_way_leads_around_limits(child, function):
    refuses(child, function, kind=int)


def test_a_pair_of_sockets_leads_nowhere_else(child):
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        assert child.call(connect_or_tell, int(kind), kind=int, seconds=5) == 1
    assert child.call(talk_to_itself, kind=int, seconds=5) == 1


def talk_to_itself() -> int:
    first, second = socket.socketpair()
    first.sendall(b"x")
    return len(second.recv(9))


def test_what_libraries_need_is_allowed(child):
    assert child.call(ordinary, kind=int, seconds=20) == 3


def ordinary() -> int:
    """Own limits and threads, children, terminals and descriptors."""
    resource.setrlimit(resource.RLIMIT_STACK, resource.getrlimit(resource.RLIMIT_STACK))
    os.sched_setaffinity(0, os.sched_getaffinity(0))
    os.isatty(1)
    os.set_blocking(1, True)
    said = []
    thread = threading.Thread(target=said.append, args=(1,))
    thread.start()
    thread.join()
    subprocess.run([sys.executable, "-c", ""], check=True)
    pid = os.fork()
    if not pid:
        os._exit(2)
    return said[0] + os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def test_nothing_is_kept_in_locks_and_attributes_of_files(child, hidden):
    path = hidden.parents[1] / "data"
    before = path.stat()
    assert child.call(lock, str(path), kind=int, seconds=5) == errno.ENOLCK
    child.call(mark, str(path), kind=int, seconds=5)
    after = path.stat()
    assert (before.st_mode, before.st_mtime_ns) == (after.st_mode, after.st_mtime_ns)


def mark(path: str) -> int:
    os.utime(path, (1, 1))
    Path(path).chmod(0o777)
    return 0


def test_a_log_keeps_what_others_have_said(tmp_path):
    log = tmp_path / "log"
    log.write_text("before\n")
    child = Child(restricted=True, log=log)
    try:
        child.call(say, "first", kind=int, seconds=5)
        child.renew()
        assert child.call(cut_the_log, kind=int, seconds=5) == 0
    finally:
        child.stop()
    assert log.read_text() == "before\nfirst\n"


def test_what_is_kept_from_foreign_code_can_be_told():
    assert "the run folder" in restrictions()
    assert "all files but a list" in restrictions()
    assert "signals to other processes" in restrictions()


class Kernel:
    """Record what a process asks of a kernel with some version of Landlock."""

    def __init__(self, version: int) -> None:
        self.version, self.calls = version, []
        self.rights: tuple[int, ...] = ()
        self.size = 0
        self.rules: dict[str, int] = {}
        self.refuses = False

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
        return -1 if self.refuses else 0

    def prctl(self, *arguments: int) -> int:
        assert arguments == (38, 1, 0, 0, 0) or arguments[0] == 24
        self.calls.append(arguments[0])
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
def test_every_kernel_is_asked_for_all_that_it_knows(version, tmp_path, monkeypatch):
    kernel = Kernel(version)
    monkeypatch.setattr(sandbox, "_libc", lambda: kernel)
    monkeypatch.setattr(sandbox, "filter_system_calls", lambda: kernel.calls.append(22))
    monkeypatch.setattr(sandbox, "filters_system_calls", lambda: False)
    own, data = tmp_path / "own", tmp_path / "data"
    own.mkdir()
    data.write_text("")
    sandbox.restrict([data, Path("/usr")], [tmp_path], own)
    bits, net, scoped, size = LANDLOCK[version]
    every = 2**bits - 1
    assert kernel.rights == (every, net, scoped)
    assert kernel.size == size
    # No new privileges, then rules, then the filter, which leaves no way back.
    assert kernel.calls.index(38) < kernel.calls.index(445)
    assert kernel.calls[-2:] == [446, 22]
    assert kernel.rules[str(data)] == 1 | 4  # a file: no listing
    assert kernel.rules["/usr"] == 1 | 4 | 8
    assert kernel.rules[str(tmp_path)] == 8
    assert kernel.rules[str(own)] == every & ~1  # nothing that it wrote is run
    assert kernel.rules["/dev/null"] == 2 | 4
    assert "/" not in kernel.rules and "/dev/shm" not in kernel.rules
    told = ["the run folder", "all files but a list", "writing outside of its folder"]
    told += ["TCP connections"] * (version >= 4) + ["signals to other processes"] * (version >= 6)
    assert restrictions() == tuple(told)


def test_a_kernel_that_refuses_is_not_trusted(tmp_path, monkeypatch):
    kernel = Kernel(6)
    kernel.refuses = True
    monkeypatch.setattr(sandbox, "_libc", lambda: kernel)
    with pytest.raises(OSError, match="refuses to restrict a process"):
        sandbox.restrict([], [], tmp_path)


def test_without_landlock_files_are_not_restricted(tmp_path, monkeypatch):
    kernel = Kernel(-1)
    monkeypatch.setattr(sandbox, "_libc", lambda: kernel)
    monkeypatch.setattr(sandbox, "filter_system_calls", lambda: None)
    monkeypatch.setattr(sandbox, "filters_system_calls", lambda: True)
    assert landlock_version() == 0
    sandbox.restrict([], [], tmp_path)
    assert set(kernel.calls) == {24, 38, 444}
    assert not kernel.rules
    assert restrictions() == (
        *("TCP connections", "all other connections", "shared memory and queues"),
        "files' owners and times",
    )


def run_what_it_wrote() -> int:
    program = Path("program")
    with os.fdopen(os.open(program, os.O_CREAT | os.O_WRONLY, 0o700), "w") as file:
        file.write(f"#!{sys.executable}\n")
    return subprocess.run([program.absolute()], check=False).returncode


def test_it_runs_nothing_that_it_wrote(child):
    refuses(child, run_what_it_wrote, kind=int)

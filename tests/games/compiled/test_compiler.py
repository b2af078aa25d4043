"""Compiled libraries: what is kept, what is never loaded, and what is said if nothing works."""

import ctypes
import importlib.util
import os
import sys
import time
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from olne_bench import kept_files
from olne_bench.errors import UserError
from olne_bench.games.compiled import compiler

SOURCE = '__attribute__((visibility("default"))) int answer(void) { return 42; }'


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder that does not exist yet, in a new home folder."""
    compiler.backend()  # the probe of the processor is not one of the libraries counted here
    folder = tmp_path / "cache"
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(folder))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("OLNE_BENCH_CFLAGS", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    kept_files._refuse.cache_clear()
    return folder


def load(source: str = SOURCE) -> ctypes.CDLL:
    return compiler.load.__wrapped__(source)


def compile_only(source: str = SOURCE) -> None:
    """Leave a library in the cache that this process has not mapped, so that it can be harmed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ctypes, "CDLL", str)
        load(source)


def libraries(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.so"))


def test_a_library_is_compiled_once_and_kept_for_its_owner_alone(cache: Path) -> None:
    library = load()
    assert library.answer() == 42
    assert cache.stat().st_mode & 0o777 == 0o700
    (path,) = libraries(cache)
    inode = path.stat().st_ino
    load()
    assert [found.stat().st_ino for found in libraries(cache)] == [inode]
    assert not list(cache.glob("compiling-*"))


def test_flags_are_part_of_the_key_and_of_the_name(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = compiler.backend()
    assert plain.startswith("native: ")
    load()
    before = len(libraries(cache))
    monkeypatch.setenv("OLNE_BENCH_CFLAGS", "-O1 -g")
    load()
    assert len(libraries(cache)) == before + 1
    assert compiler.backend() == f"{plain}, -O1, -g"


@pytest.mark.parametrize("wide", [True, False])
def test_code_is_for_the_kind_of_processor_that_this_is(
    wide: bool, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load()
    monkeypatch.setattr(compiler, "_processor_flags", lambda _: compiler._WIDE_FLAGS * wide)
    assert ("-mavx2, -mfma" in compiler.backend()) == wide
    here = "avx2" in Path("/proc/cpuinfo").read_text() if sys.platform == "linux" else wide
    before = len(libraries(cache))
    if wide <= here:
        assert load().answer() == 42
        assert len(libraries(cache)) == before + (wide != here)


@pytest.mark.parametrize("harm", ["truncated", "other content", "empty", "writable", "link"])
def test_what_is_damaged_or_open_to_others_is_compiled_anew(
    harm: str, cache: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    compile_only()
    (path,) = libraries(cache)
    content = path.read_bytes()
    if harm == "truncated":
        path.write_bytes(content[: len(content) // 2])
    elif harm == "other content":
        path.write_bytes(content[:-1] + b"\1")
    elif harm == "empty":
        path.write_bytes(b"")
    elif harm == "writable":
        path.chmod(0o722)
    else:
        path.rename(tmp_path / "elsewhere.so")
        path.symlink_to(tmp_path / "elsewhere.so")
    library = load()
    assert library.answer() == 42
    (again,) = libraries(cache)
    assert again.read_bytes() == content
    assert not again.is_symlink()
    assert again.stat().st_mode & 0o022 == 0
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f"olne-bench: {path} is ")
    assert line.endswith(": compiled anew")


def test_a_library_under_the_name_of_another_is_not_loaded(cache: Path) -> None:
    compile_only()
    compile_only(SOURCE.replace("42", "43"))
    first, second = libraries(cache)
    swapped = first.name[:32] + second.name[32:]
    first.unlink()
    second.rename(cache / swapped)
    library, other = load(), load(SOURCE.replace("42", "43"))
    assert (library.answer(), other.answer()) == (42, 43)


def test_an_object_serves_all_libraries_that_share_it(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = "int number(void) { return 40; }"
    sources = ["int number(void);" + SOURCE.replace("42", f"number() + {more}") for more in (2, 3)]
    answers = [compiler.load.__wrapped__(one, shared=(shared,)).answer() for one in sources]
    assert answers == [42, 43]
    (kept,) = cache.glob("*.o")
    content, made = kept.read_bytes(), kept.stat().st_ino
    kept.write_bytes(content[:-1] + b"\1")
    third = "int number(void);" + SOURCE.replace("42", "number() + 4")
    assert compiler.load.__wrapped__(third, shared=(shared,)).answer() == 44
    (again,) = cache.glob("*.o")
    assert again.read_bytes() == content and again.stat().st_ino != made
    monkeypatch.setattr(compiler, "SIZE_LIMIT", 1)
    load()
    assert not list(cache.glob("*.o"))


@pytest.mark.parametrize("wrong", ["writable by others", "owned by another user", "a file"])
def test_a_folder_that_is_not_ours_alone_is_not_used(
    wrong: str,
    cache: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    if wrong == "a file":
        cache.write_text("")
    else:
        cache.mkdir()
    if wrong == "writable by others":
        cache.chmod(0o777)
    if wrong == "owned by another user":
        user = os.getuid()
        monkeypatch.setattr(os, "getuid", lambda: user + 1)
    library = load()
    assert library.answer() == 42
    assert not cache.is_dir() or not libraries(cache)
    error = capfd.readouterr().err
    assert f"the cache folder {cache} is not used: " in error
    if wrong != "owned by another user":
        assert len(libraries(tmp_path / "home" / ".cache" / "olne-bench")) == 1


@pytest.mark.usefixtures("cache")
def test_the_folder_follows_the_standard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OLNE_BENCH_CACHE")
    load()
    assert len(libraries(tmp_path / "home" / ".cache" / "olne-bench")) == 1
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    load()
    assert len(libraries(tmp_path / "xdg" / "olne-bench")) == 1


def test_the_least_recently_used_libraries_go(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = [SOURCE.replace("42", str(number)) for number in range(4)]
    found: list[Path] = []
    for age, source in enumerate(sources[:3]):
        compile_only(source)
        (new,) = set(libraries(cache)) - set(found)
        os.utime(new, (time.time() - 100 + age,) * 2)
        found.append(new)
    load(sources[0])  # used again, hence no longer the oldest
    left = cache / "compiling-abandoned"
    left.mkdir()
    os.utime(left, (0, 0))
    monkeypatch.setattr(compiler, "SIZE_LIMIT", int(2.5 * found[0].stat().st_size))
    load(sources[3])
    kept = libraries(cache)
    assert found[0] in kept
    assert found[1] not in kept
    assert len(kept) == 2
    assert not left.exists()


@pytest.mark.parametrize(
    ("variable", "value", "reason"),
    [
        ("CC", "no-such-compiler", "no C compiler 'no-such-compiler' found"),
        ("CC", "no-such-compiler", "pip install 'olne-bench[compiler]'"),
        ("CC", "false", "false failed: exit code 1"),
        ("OLNE_BENCH_CFLAGS", "--no-such-flag", "--no-such-flag"),
    ],
)
@pytest.mark.usefixtures("cache")
def test_without_a_compiler_that_works_one_line_says_why(
    variable: str, value: str, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(variable, value)
    with pytest.raises(UserError) as error:
        load()
    assert reason in str(error.value) and "\n" not in str(error.value)


def test_the_compiler_of_the_package_index_serves_where_there_is_no_other(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    found = ModuleSpec("ziglang", None, origin=str(tmp_path / "ziglang" / "__init__.py"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: found)
    command = compiler._compiler()
    assert command == (str(tmp_path / "ziglang" / "zig"), "cc", "-mcpu=baseline")
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(UserError, match="no C compiler 'cc' found"):
        compiler._compiler()

"""Run the solvers' tests with native code under the address and undefined-behaviour sanitizers.

    python scripts/sanitize.py [TESTS...]

The libraries are compiled with ``-fsanitize=address,undefined`` into a separate cache, and Python
starts with the compiler's sanitizer runtime preloaded. Any report fails the tests. Leaks are not
checked, as Python and CasADi keep memory until the end. Needs gcc on Linux, as clang names its
runtime differently.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
TESTS = (
    "tests/games/solve/test_newton.py",
    "tests/games/compiled/test_elimination.py",
    "tests/games/compiled/test_four_games.py",
    "tests/games/compiled/test_row_functions.py",
    "tests/games/solve/test_feedback.py",
    "tests/estimators/shared/test_interior_point.py",
    "tests/estimators/shared/test_pooled.py::test_drivers_of_different_games_are_recovered_without_noise",
)
#: The code of games on lanes is a megabyte long, and five players test no more than two.
LEFT_OUT = "not lanes and not highway"
FLAGS = "-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer -g -O0"
#: CasADi loads IPOPT with a flag that the sanitizer's runtime refuses.
SHIM = """
#define _GNU_SOURCE
#include <dlfcn.h>
void *dlopen(const char *file, int mode)
{
    void *(*next)(const char *, int) = (void *(*)(const char *, int))dlsym(RTLD_NEXT, "dlopen");
    return next(file, mode & ~RTLD_DEEPBIND);
}
"""
SAMPLE = "int sample(int i) { int a[2] = {0, 1}; volatile int k = i; return a[k]; }"


def main() -> None:
    """Check that the sanitizer finds a planted error; then run the tests."""
    compiler = shutil.which(os.environ.get("CC", "gcc"))
    if compiler is None:
        raise SystemExit("sanitize.py needs gcc; CC names another")
    visible = '__attribute__((visibility("default"))) '
    planted = (
        "from olne_bench.games.compiled import compiler\n"
        f"compiler.load({visible + SAMPLE!r}).sample(7)\n"
    )
    tests = sys.argv[1:] or [*TESTS, "-k", LEFT_OUT]
    with tempfile.TemporaryDirectory() as cache:
        given: dict[str, Any] = {"cwd": ROOT, "env": sanitized(compiler, Path(cache))}
        command = [sys.executable, "-c", planted]
        ended = subprocess.run(command, capture_output=True, text=True, **given)
        if ended.returncode == 0 or "runtime error" not in ended.stderr + ended.stdout:
            raise SystemExit(f"the sanitizer misses a planted error:\n{ended.stderr}")
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-s", *tests]
        raise SystemExit(subprocess.run(command, **given).returncode)


def sanitized(compiler: str, cache: Path) -> dict[str, str]:
    """The environment of a process whose native code is sanitized."""
    runtimes = [runtime(compiler, name) for name in ("libasan.so", "libubsan.so", "libstdc++.so")]
    code, shim = cache / "shim.c", cache / "shim.so"
    code.write_text(SHIM)
    subprocess.run([compiler, "-shared", "-fPIC", str(code), "-o", str(shim), "-ldl"], check=True)
    unwatched = cache / "cc"  # the compiler itself needs no watching, and is slow under it
    unwatched.write_text(f'#!/bin/sh\nunset LD_PRELOAD\nexec "{compiler}" "$@"\n')
    unwatched.chmod(0o700)
    return os.environ | {
        "CC": str(unwatched),
        "OLNE_BENCH_CACHE": str(cache),
        "OLNE_BENCH_CFLAGS": FLAGS,
        "LD_PRELOAD": " ".join([str(shim), *runtimes]),
        "ASAN_OPTIONS": "detect_leaks=0:verify_asan_link_order=0:abort_on_error=1",
        "UBSAN_OPTIONS": "print_stacktrace=1:halt_on_error=1:abort_on_error=1",
        "PYTHONMALLOC": "malloc",  # the allocator of Python would hide an array's ends
    }


def runtime(compiler: str, name: str) -> str:
    """Path of a compiler's library.

    Raises:
        SystemExit: if it is not installed.
    """
    found = subprocess.run(
        [compiler, f"-print-file-name={name}"], check=True, capture_output=True, text=True
    )
    path = Path(found.stdout.strip())
    if not path.is_absolute():
        raise SystemExit(f"{compiler} has no {name}: install its sanitizers")
    return str(path.resolve())


if __name__ == "__main__":
    main()

"""Fingerprints of source code, which ignore comments, formatting and docstrings.

A fingerprint covers modules, what they import from given packages, and files beside them that share
their name or that they name. It does not cover what code finds in other ways, as by ``importlib``.
"""

import glob
import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from importlib.machinery import BYTECODE_SUFFIXES, EXTENSION_SUFFIXES, SOURCE_SUFFIXES
from pathlib import Path

from olne_bench.bench.plan.source_summary import Summary, summarised

#: Modules that no result depends on, though others import them: lists of public names and of
#: plugins, one that gives names to worlds, and one that starts processes, which says where code
#: runs and not what it computes.
_OF_NO_RESULT = {
    "olne_bench",
    "olne_bench.catalogue",
    "olne_bench.envs.worlds.gym_ids",
    "olne_bench.bench.process.child",
}
_NO_DATA = {".py", ".pyc", ".pyo", ".so", ".pyd"}
#: Ends of names of modules, in the order in which Python looks for them.
_MODULES = (*EXTENSION_SUFFIXES, *SOURCE_SUFFIXES, *BYTECODE_SUFFIXES)
LENGTH = 12


def fingerprint(modules: Mapping[str, Path], roots: Mapping[str, Path], own: Path | None) -> str:
    """Fingerprint of modules and of what they import from ``roots``, or from the folder ``own``.

    A root is a package's dotted name, and the folder above its first part. Modules of ``own`` count
    under any other top-level name.
    """
    found = modules_used(modules, roots, own)
    digest = hashlib.sha256()
    for name in sorted(found):
        digest.update(f"{name} {_content(found[name])}\n".encode())
    return digest.hexdigest()[:LENGTH]


def modules_used(
    modules: Mapping[str, Path], roots: Mapping[str, Path], own: Path | None
) -> dict[str, Path]:
    """Names and files of modules and of all that they import, as ``fingerprint`` counts them."""
    found: dict[str, Path] = {}
    pending, known = list(modules.items()), tuple(roots.items())
    while pending:
        name, path = pending.pop()
        if name not in found and name not in _OF_NO_RESULT:
            found[name] = path
            pending += _imported(path, name, known, own)
    return found


@lru_cache(maxsize=1024)
def _imported(
    path: Path, name: str, roots: tuple[tuple[str, Path], ...], own: Path | None
) -> tuple[tuple[str, Path], ...]:
    """Names and files of what a module imports itself."""
    folders = ((one, _folder(one, roots, own)) for one in set(_imported_names(path, name)))
    files = ((one, folder and _locate(folder, one)) for one, folder in folders)
    return tuple((one, file) for one, file in files if file)


def data_beside(path: Path) -> list[Path]:
    """Files beside a module or below that share its name, or that it names (or by ``*``)."""
    patterns = set(_summary(path).files)
    if path.name != "__init__.py":
        patterns.add(f"{glob.escape(path.stem)}.*")
    found = {file for pattern in patterns for file in _matching(path.parent, pattern)}
    return sorted(found - {path})


def _matching(folder: Path, pattern: str) -> list[Path]:
    if "**" in pattern:  # as in Markdown; whole trees are no part of a module
        return []
    # Modules count where they are imported.
    with suppress(OSError, ValueError):  # a string that can be no name of a file
        return [f for f in folder.glob(pattern) if f.suffix not in _NO_DATA and f.is_file()]
    return []


def _folder(name: str, roots: tuple[tuple[str, Path], ...], own: Path | None) -> Path | None:
    """Where to look for a module; None if it does not count."""
    for package, folder in roots:
        if name == package or name.startswith(f"{package}."):
            return folder
    known = {package.partition(".")[0] for package, _ in roots}
    return None if name.partition(".")[0] in known else own


@lru_cache(maxsize=8192)
def _locate(folder: Path, name: str) -> Path | None:
    path = folder.joinpath(*name.split("."))
    beside = _listed(path.parent)
    inside = _listed(path) if path.name in beside else ()
    places = [(path / "__init__", inside), (path, beside)]
    for stem, there in places:
        for file in (f"{stem.name}{suffix}" for suffix in _MODULES):
            if file in there and (found := stem.with_name(file)).is_file():
                return found
    return None


def _listed(folder: Path) -> frozenset[str]:
    """Names of what is in a folder; none if there is no such folder."""
    try:
        return frozenset(one.name for one in os.scandir(folder))
    except OSError:
        return frozenset()


def _imported_names(path: Path, name: str) -> Iterator[str]:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    yield from _parents(package)
    found = _summary(path)
    for one in found.imports:
        base = one.module
        if one.level:
            parts = package.split(".")
            base = ".".join([*parts[: len(parts) - one.level + 1], *filter(None, [base])])
        yield from _parents(base)
        yield from (f"{base}.{name}" for name in one.names)
    yield from (f"olne_bench.envs.{name}" for name in found.worlds)


def _parents(name: str) -> Iterator[str]:
    """``a``, ``a.b`` and ``a.b.c`` for ``a.b.c``."""
    parts = name.split(".") if name else []
    yield from (".".join(parts[: k + 1]) for k in range(len(parts)))


@lru_cache(maxsize=512)
def _summary(path: Path) -> Summary:
    return summarised(path.read_bytes())


@lru_cache(maxsize=512)
def _content(path: Path) -> str:
    code = _summary(path).code
    digest = hashlib.sha256(path.read_bytes() if code is None else code.encode())
    for sibling in data_beside(path):
        name = sibling.relative_to(path.parent).as_posix()
        digest.update(f"{name}\n".encode() + sibling.read_bytes())
    return digest.hexdigest()

"""What a fingerprint needs of a source file: a digest of its code, what it imports, and its files.

Comments, formatting and docstrings do not count. Digests are the same in all versions of Python.

Reading all sources takes seconds, which every process of a run would spend again. So summaries are
kept (``olne_bench.kept_files``); a file's name is a digest of the source and of Python's version.
"""

import ast
import hashlib
import re
import sys
from contextlib import suppress
from typing import Any

import msgspec

from olne_bench.kept_files import KeptFiles

#: Changes with what a summary holds.
_FORMAT = 5
_KEPT = KeptFiles("-sources", most_bytes=10_000_000)
#: Worlds are named by strings such as "highway_v0" and imported at their first use.
_WORLD = re.compile(r"[a-z]\w*_v\d+")
#: A file's name or path, or a pattern of some.
_FILE = re.compile(r"[\w*][\w*.-]*(/[\w*][\w*.-]*)*\.\w+")
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Import(msgspec.Struct, frozen=True):
    """One import: ``import <module>``, or ``from <module> import <names>`` at a relative level."""

    module: str
    names: tuple[str, ...] = ()
    level: int = 0


class Summary(msgspec.Struct, frozen=True):
    """A source file."""

    code: str | None  # digest of the code without comments and docstrings; None if it is not Python
    imports: tuple[Import, ...] = ()
    worlds: tuple[str, ...] = ()  # names of worlds in its strings
    files: tuple[str, ...] = ()  # strings that may be names of files, or patterns of names


def summarised(source: bytes) -> Summary:
    """The summary of a source, from the folder of kept ones if it is there."""
    version = f"{_FORMAT} {sys.version_info.major}.{sys.version_info.minor} ".encode()
    name = f"{hashlib.sha256(version + source).hexdigest()}.json"
    with suppress(msgspec.MsgspecError):
        if content := _KEPT.read(name):
            return msgspec.json.decode(content, type=Summary)
    found = _made(source)
    _KEPT.write(name, msgspec.json.encode(found))
    return found


def _made(source: bytes) -> Summary:
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # the last two: nested too deep
        return Summary(None)
    for node in [] if _reads_docstrings(tree) else ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:] or [ast.Pass()]
    imports, texts = [], set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [Import(alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = tuple(alias.name for alias in node.names)
            imports.append(Import(node.module or "", names, node.level))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            texts.add(node.value)
    worlds, files = (tuple(sorted(filter(kind.fullmatch, texts))) for kind in (_WORLD, _FILE))
    return Summary(_digest(tree), tuple(imports), worlds, files)


def _reads_docstrings(tree: ast.AST) -> bool:
    """Whether code may depend on docstrings, which then count."""
    names = (getattr(node, "id", getattr(node, "attr", "")) for node in ast.walk(tree))
    return "__doc__" in names


def _digest(tree: ast.AST) -> str:
    """Digest of a syntax tree: of names of nodes and fields, and of values, in their order.

    Not of ``ast.unparse`` or ``ast.dump``: versions of Python choose other quotes in f-strings, and
    have other fields that are empty in most code. No recursion, as trees may be deep.
    """
    digest = hashlib.sha256()
    pending: list[ast.AST | str] = [tree]
    while pending:
        one = pending.pop()
        if isinstance(one, str):
            digest.update(f"{one} ".encode())
            continue
        pending.append(")")
        for name, value in reversed(list(ast.iter_fields(one))):
            parts = _parts(one, value)
            if parts:
                pending += [part if isinstance(part, ast.AST) else ascii(part) for part in parts]
                pending.append(f"{name}=")
        pending.append(f"{type(one).__name__}(")
    return digest.hexdigest()


def _parts(owner: ast.AST, value: Any) -> list[Any]:
    """What a field holds, last part first; no empty text in f-strings, which Python 3.12.1 adds."""
    if isinstance(owner, ast.JoinedStr):
        value = [part for part in value if getattr(part, "value", None) != ""]
    if isinstance(value, list):
        return value[::-1]
    return [] if value is None else [value]

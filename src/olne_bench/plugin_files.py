"""Load the file of a plugin under a unique module name, with the helper modules beside it."""

import importlib.util
import re
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import lru_cache
from hashlib import sha256
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

#: Characters that no name of a module has.
_NO_NAME = re.compile(r"[^0-9A-Za-z_]")


class Home:
    """The folder of a plugin, whose modules can be imported while the plugin's code runs.

    At other times neither the folder nor its modules can be found. So two plugins with helpers of
    the same name each get their own, and no helper hides a module that others import. Python's own
    and installed modules take precedence over those of the folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder)
        self._names = _helper_names(folder)
        self._modules: dict[str, ModuleType] = {}
        self._path: list[str] = []

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Find a module of the folder by its name (the interface of Python's finders)."""
        if path is None and name in self._names:
            return PathFinder.find_spec(name, [self._folder])
        return None

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Within this context, the plugin's helper modules and its ``sys.path`` are in place."""
        if any(finder is self for finder in sys.meta_path):
            yield
            return
        others, path = self._take_modules(), list(sys.path)
        sys.modules.update(self._modules)
        sys.path[:0] = self._path
        sys.meta_path.insert(0, self)
        try:
            yield
        finally:
            with suppress(ValueError):
                sys.meta_path.remove(self)
            self._path = [entry for entry in sys.path if entry not in path]
            sys.path[:] = path
            self._modules = self._take_modules()
            sys.modules.update(others)

    def _take_modules(self) -> dict[str, ModuleType]:
        """Remove from ``sys.modules`` all modules with names of the folder, and return them."""
        if not any(name in sys.modules for name in self._names):
            return {}  # searching all modules is slow, and this happens in every trial
        own = [name for name in sys.modules if name.partition(".")[0] in self._names]
        return {name: sys.modules.pop(name) for name in own}


_homes: dict[str, Home] = {}


def module_name(path: Path) -> str:
    """Name of the module made from a plugin's file, unique to the path."""
    digest = sha256(bytes(path)).hexdigest()[:12]
    return f"olne_bench_plugin_{_NO_NAME.sub('_', path.stem)}_{digest}"


@lru_cache(maxsize=64)  # so that a plugin's module keeps its state
def load_file(path: Path) -> ModuleType:
    """The module of a plugin's file, an absolute path; raises whatever the file raises."""
    name = module_name(path)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    _forget_listing(path.parent)  # files beside it may be newer
    home = _homes[name] = Home(path.parent)
    sys.modules[name] = module  # dataclasses and pickle look for it there
    try:
        with home.entered():
            spec.loader.exec_module(module)
    except BaseException:
        sys.modules.pop(name, None)
        raise
    return module


def _forget_listing(folder: Path) -> None:
    """Have Python look again at what is in a folder; its other listings take long to make."""
    sys.path_importer_cache.pop(str(folder), None)


def at_home(plugin: object) -> AbstractContextManager[None]:
    """Within this context, helper modules beside a plugin's file can be imported, and no others."""
    kind = plugin if issubclass(type(plugin), type) else type(plugin)
    try:
        home = _homes.get(type.__getattribute__(kind, "__module__"))
    except BaseException:  # a metaclass may do anything
        home = None
    return nullcontext() if home is None else home.entered()


def _helper_names(folder: Path) -> frozenset[str]:
    found = {module.name for module in iter_modules([str(folder)])}
    with suppress(OSError):  # folders without __init__.py are packages too
        found |= {f.name for f in folder.iterdir() if f.name.isidentifier() and any(f.glob("*.py"))}
    python = {*sys.stdlib_module_names, "olne_bench"}
    return frozenset(name for name in found - python if not _is_installed(name))


def _is_installed(name: str) -> bool:
    places = [p for p in sys.path if Path(p).name in ("site-packages", "dist-packages")]
    spec = PathFinder.find_spec(name, places)
    return spec is not None and spec.origin is not None

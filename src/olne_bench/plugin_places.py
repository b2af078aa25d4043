"""Where plugins are: built in, installed or in files, found without importing them."""

import os
import re
import sys
from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache, lru_cache
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from olne_bench.plugin_files import module_name
from olne_bench.plugin_kinds import Kind, PluginError, guarded

_PACKAGE = Path(__file__).parent


def names(kind: Kind) -> list[str]:
    """Names of the built-in and the installed plugins of a kind, without importing them."""
    return sorted({*built_in(kind), *_installed(kind)})


def is_file(reference: str) -> bool:
    """Whether a reference names a file rather than a known plugin."""
    return split(reference) is not None


def is_built_in(kind: Kind, reference: str) -> bool:
    """Whether a reference names a plugin of this package."""
    return not is_file(reference) and reference in built_in(kind)


def absolute(reference: str) -> str:
    """The reference in a form that can be used from any folder.

    Raises:
        PluginError: on an impossible path.
    """
    parts = split(reference)
    if parts is None:
        return reference
    path, class_name = parts
    return f"{_resolved(path)}:{class_name}" if class_name else str(_resolved(path))


def file_of(reference: str) -> Path | None:
    """The file that a reference names, an absolute path; None for the name of a known plugin.

    Raises:
        PluginError: on an impossible path.
    """
    parts = split(reference)
    return None if parts is None else _resolved(parts[0])


def source(kind: Kind, reference: str) -> tuple[str, Path]:
    """Name and file of the module that defines a plugin, found without running it.

    Raises:
        PluginError: if the plugin is unknown or its module has no file.
    """
    parts = split(reference)
    if parts is not None:
        path = known_file(kind.name, parts[0])
        return module_name(path), path
    place = find(kind, reference)
    if isinstance(place, Path):
        return f"{kind.package}.{place.stem}", place
    path = _module_file(kind, place)
    return place.module, path


def split(reference: str) -> tuple[str, str] | None:
    """Path and class name of a file's reference; None for a name."""
    if not isinstance(reference, str):  # callers may pass anything
        return None
    if reference.endswith(".py"):
        return reference, ""
    path, _, class_name = reference.rpartition(":")
    return (path, class_name) if path.endswith(".py") else None


def _resolved(path: str) -> Path:
    try:
        return Path(path).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # NUL, circles of links
        raise PluginError(f"no file {path!r}: {error}") from error


def known_file(what: str, path: str) -> Path:
    """The absolute path of a plugin's file, which is there."""
    if "\0" in path or not os.path.isfile(path):  # noqa: PTH113 (Path raises on long names)
        raise PluginError(f"no {what} file {path!r}")
    return _resolved(path)


@cache
def built_in(kind: Kind) -> dict[str, Path]:
    """Files that define a plugin of their own name, found in their text, as imports are slow."""
    folder = _PACKAGE.joinpath(*kind.package.split(".")[1:])
    line = r'^    name(: ClassVar\[str\])? = "{}"$'
    return {
        path.stem: path
        for path in sorted(folder.glob("*.py"))
        if re.search(line.format(path.stem), path.read_text(encoding="utf-8"), re.MULTILINE)
    }


def _installed(kind: Kind) -> dict[str, tuple[EntryPoint, ...]]:
    return listed_points(kind.group, tuple(sys.path))


@lru_cache(maxsize=64)  # asked for with every trial
def listed_points(group: str, _path: tuple[str, ...]) -> dict[str, tuple[EntryPoint, ...]]:
    """Entry points of a group by name, as long as the search path is the same."""
    found: dict[str, dict[str, EntryPoint]] = {}
    for point in entry_points(group=group):
        found.setdefault(point.name, {})[point.value] = point
    return {name: tuple(points.values()) for name, points in found.items()}


def find(kind: Kind, reference: str) -> Path | EntryPoint:
    """Where a known plugin is."""
    if not isinstance(reference, str):
        raise unknown(kind, reference)
    ours, installed = built_in(kind).get(reference), _installed(kind).get(reference, ())
    if len(installed) + (ours is not None) > 1:
        places = [f"{owner(point)} ({point.value})" for point in installed]
        places = ["the built-in one"] * (ours is not None) + places
        raise PluginError(
            f"there are {len(places)} {kind.name}s called {reference!r}: {', '.join(places)}; "
            "rename or uninstall one"
        )
    if ours is not None:
        return ours
    if installed:
        return installed[0]
    raise unknown(kind, reference)


def unknown(kind: Kind, reference: object) -> PluginError:
    """The error on a name that no plugin has."""
    known = names(kind)
    return PluginError(
        f"unknown {kind.name} {reference!r}; known are: {', '.join(known)}, "
        f"or a file path.py:ClassName{nearest(reference, known)}"
    )


def nearest(name: object, known: Iterable[str]) -> str:
    """The names that are most like another one, as the end of a message; empty if none is."""
    found = ", ".join(get_close_matches(str(name), [*known]))
    return f"; nearest: {found}" if found else ""


def owner(point: EntryPoint) -> str:
    """The package that an entry point is of, as text."""
    return f"of {point.dist.name}" if point.dist else "of a package without a name"


def _module_file(kind: Kind, point: EntryPoint) -> Path:
    """File of an entry point's module, without importing the packages that contain it."""
    what = f"{kind.name} {point.name!r} {owner(point)}"
    places: list[str] | None = None
    full = ""
    spec = None
    module = guarded(f"{what} does not refer to a class", lambda: point.module)
    for part in module.split("."):
        full = f"{full}.{part}" if full else part
        spec, places = _spec_below(full, places)
        if spec is None and places is None:
            raise PluginError(f"{what} cannot be found: no module {full!r} ({point.value})")
    if spec is None or not spec.origin or not Path(spec.origin).is_file():
        raise PluginError(f"{what} has no file: {point.value}")
    return Path(spec.origin).resolve()


def _spec_below(full: str, places: list[str] | None) -> tuple[ModuleSpec | None, list[str] | None]:
    """Spec of a module from Python's finders, and the folders of its submodules."""
    for finder in sys.meta_path:
        try:
            spec = finder.find_spec(full, places)
        except Exception:  # such as folders without __init__.py, which ask for an imported parent
            spec = None
        if spec is not None:
            inner = spec.submodule_search_locations
            return spec, None if inner is None else list(inner)
    last = full.rpartition(".")[2]
    folders = [str(Path(place) / last) for place in places or [] if (Path(place) / last).is_dir()]
    return None, folders or None

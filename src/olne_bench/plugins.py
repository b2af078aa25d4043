"""Plugins: estimators, scenarios, sensors and metrics, from this package and from others.

A plugin is a class with a class attribute ``name`` and the method of its kind. The arguments of its
constructor are its parameters. It is

- built in: a file with its name in the folder of its kind;
- installed: an entry point with its name in the group of its kind;
- in a file: ``path.py:ClassName``, or ``path.py`` if the file defines only one.
"""

import inspect
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from olne_bench.plugin_files import at_home, load_file
from olne_bench.plugin_kinds import (
    ESTIMATOR,
    KINDS,
    METRIC,
    SCENARIO,
    SENSOR,
    Kind,
    PluginError,
    attribute,
    describe_foreign_error,
    guarded,
    text_of,
    type_name,
)
from olne_bench.plugin_places import (
    absolute,
    built_in,
    file_of,
    find,
    is_built_in,
    is_file,
    known_file,
    names,
    owner,
    source,
    split,
    unknown,
)

__all__ = [
    "ESTIMATOR",
    "KINDS",
    "METRIC",
    "SCENARIO",
    "SENSOR",
    "Description",
    "Kind",
    "PluginError",
    "absolute",
    "at_home",
    "describe",
    "describe_foreign_error",
    "file_of",
    "find_class",
    "is_built_in",
    "is_file",
    "kind_of",
    "label",
    "loading",
    "make",
    "named_by_data",
    "names",
    "parameter_names",
    "source",
]

_LONGEST_NAME = 100
_LONGEST_DESCRIPTION = 300

_loadable: ContextVar[frozenset[str] | None] = ContextVar("loadable", default=None)


@contextmanager
def loading(*references: str) -> Iterator[None]:
    """Within this context, the plugins that are imported are built-in ones and these, no others.

    So a name that a file of data holds never runs code that its user has not named.
    """
    token = _loadable.set(frozenset(map(_home, references)))
    try:
        yield
    finally:
        _loadable.reset(token)


def _home(reference: str) -> str:
    return str(file_of(reference) or reference)


def _refuse_unnamed(reference: str) -> None:
    loadable = _loadable.get()
    if loadable is not None and isinstance(reference, str) and _home(reference) not in loadable:
        raise PluginError(
            f"plugin {reference!r} is not loaded: only what the command line names is (--plugin)"
        )


@dataclass(frozen=True)
class Description:
    """What other processes need to know about a plugin, as plain data.

    Attributes:
        kind: name of its kind; empty if unknown.
        reference: reference that can be used from any folder.
        label: its name.
        parameters: names of its parameters.
        family: for a scenario, whether each seed draws another member.
        several: for an estimator, whether it takes several trajectories at once.
        declaration: its declared attributes (``Kind.declares``) as text, numbers and booleans.
        error: one line on what is wrong with it; empty if nothing is.
    """

    kind: str = ""
    reference: str = ""
    label: str = ""
    parameters: tuple[str, ...] = ()
    family: bool = False
    several: bool = False
    declaration: dict[str, str | float | bool] = field(default_factory=dict)
    error: str = ""


def named_by_data(kind: Kind, name: str, place: str, option: str) -> str:
    """A name that a data file gives, if it is that of a built-in plugin.

    Data choose no code: other plugins run only if the command line names them.

    Args:
        kind: kind of the plugin.
        name: what the file says.
        place: the file, for messages.
        option: the option that names other plugins, for messages.

    Raises:
        PluginError: on any other name.
    """
    if is_built_in(kind, name):
        return name
    raise PluginError(
        f"{place} names the {kind.name} {name[:_LONGEST_NAME]!r}, and a file can only name a "
        f"built-in one: {', '.join(sorted(built_in(kind)))}; to use another, name it with {option}"
    )


def find_class(kind: Kind, reference: str) -> type[Any]:
    """Import a plugin's class.

    Args:
        kind: kind of the plugin.
        reference: a name from ``names(kind)``, or ``path.py`` / ``path.py:ClassName``.

    Raises:
        PluginError: with one line that names the alternatives, or file and line of the cause.
    """
    if not isinstance(reference, str):
        raise unknown(kind, reference)
    if not is_built_in(kind, reference):
        _refuse_unnamed(reference)
    parts = split(reference)
    if parts is not None:
        return _class_from_file(kind, known_file(kind.name, parts[0]), parts[1])
    return _known_class(kind, reference, tuple(sys.path))


def make(kind: Kind, reference: str, parameters: Mapping[str, Any] | None = None) -> Any:
    """Construct a plugin with parameters.

    Raises:
        PluginError: as ``find_class``, and if the class refuses its parameters.
    """
    found = find_class(kind, reference)
    caught = (TypeError, ValueError) if is_built_in(kind, reference) else BaseException
    try:
        with at_home(found):
            return found(**(parameters or {}))
    except caught as error:
        what = f"{kind.name} {reference!r}"
        if isinstance(error, TypeError | ValueError):
            known = ", ".join(parameter_names(found)) or "none"
            refusal = f"{what} refuses its parameters: {text_of(error)}"
            raise PluginError(f"{refusal[:800]}; its parameters: {known}") from error
        raise PluginError(f"{what} cannot be made: {describe_foreign_error(error)}") from error


def label(kind: Kind, reference: str) -> str:
    """The name that tables show for a reference: the class attribute ``name``.

    Raises:
        PluginError: as ``find_class`` does.
    """
    found: str = find_class(kind, reference).name
    return found


def kind_of(reference: str) -> Kind:
    """The kind of the plugin in a file.

    Raises:
        PluginError: unless the reference names a file with one plugin, or one class of it.
    """
    parts = split(reference)
    if parts is None:
        raise PluginError(f"{reference!r} is not a plugin file: expected path.py or path.py:Class")
    _refuse_unnamed(reference)
    path, class_name = known_file("plugin", parts[0]), parts[1]
    module = _load(path)
    found = [
        (name, kind)
        for kind in KINDS
        for name in _plugin_classes(kind, module, path)
        if class_name in ("", name)
    ]
    if len(found) == 1:
        return found[0][1]
    methods = ", ".join(f"{kind.method} ({kind.name})" for kind in KINDS)
    if not found:
        where = f"{class_name!r} in {str(path)!r}" if class_name else f"{str(path)!r}"
        raise PluginError(f"{where} is not a plugin: expected a class with one method of {methods}")
    choice = ", ".join(f"{name} ({kind.name})" for name, kind in found)
    raise PluginError(
        f"{str(path)!r} holds several plugins, name one as {path}:Class, with one method of "
        f"{methods} each; it has: {choice}"
    )


def describe(
    kind: Kind | None, reference: str, parameters: Mapping[str, Any] | None = None
) -> Description:
    """Describe a plugin by importing and constructing it. Never raises.

    Args:
        kind: kind of the plugin; None for a file, whose kind is then found out.
        reference: name or file of the plugin.
        parameters: parameters that it has to accept.
    """
    try:
        kind = kind or kind_of(reference)
        found, plugin = find_class(kind, reference), make(kind, reference, parameters)
        return Description(
            kind=kind.name,
            reference=absolute(reference),
            label=found.name,
            parameters=tuple(parameter_names(found)),
            family=kind == SCENARIO and takes_seed(plugin),
            several=kind == ESTIMATOR and attribute(plugin, "several", reference) is True,
            declaration=_declaration(kind, plugin, reference),
        )
    except PluginError as error:
        return Description(kind=kind.name if kind else "", reference=reference, error=str(error))


def import_file(reference: str) -> None:
    """Import a plugin's file, so that objects of its classes can be unpickled.

    Other plugins are imported by pickle itself. Raises whatever the file raises.
    """
    _refuse_unnamed(reference)
    path = file_of(reference)
    if path is not None:
        load_file(path)


def parameter_names(found: type[Any]) -> list[str]:
    """Names of the parameters of a plugin's class; empty if it has no readable signature."""
    try:
        return [str(name) for name in inspect.signature(found).parameters]
    except BaseException:  # this may run foreign code
        return []


def takes_seed(scenario: Any) -> bool:
    """Whether a scenario is a family, whose ``draw`` takes a seed: each draws another member.

    Where that depends on its options, the attribute ``fixed`` says so.
    """
    try:
        seeded = "seed" in inspect.signature(scenario.draw).parameters
        return seeded and not getattr(scenario, "fixed", False)
    except BaseException:  # this may run foreign code
        return False


@lru_cache(maxsize=64)  # asked for with every trial
def _known_class(kind: Kind, reference: str, _path: tuple[str, ...]) -> type[Any]:
    place = find(kind, reference)
    if isinstance(place, Path):
        module = import_module(f"{kind.package}.{place.stem}")
        classes = [c for c in vars(module).values() if isinstance(c, type)]
        own = [c for c in classes if c.__module__ == module.__name__ and hasattr(c, kind.method)]
        return next(c for c in own if getattr(c, "name", None) == reference)
    what = f"{kind.name} {reference!r} {owner(place)}"
    loaded = guarded(f"{what} cannot be imported", place.load)
    if not issubclass(type(loaded), type):
        raise PluginError(f"{what} ({place.value}) is not a class")
    if not _has_method(kind, loaded, what):
        raise PluginError(f"{what} ({place.value}) has no method {kind.method!r}")
    name = _checked_name(loaded, what)
    if name != reference:
        raise PluginError(
            f"{what} is installed under another name than its class has: {name!r}; let them agree"
        )
    found: type[Any] = loaded
    return found


def _class_from_file(kind: Kind, path: Path, class_name: str) -> type[Any]:
    found = _plugin_classes(kind, _load(path), path)
    choice = ", ".join(found) or f"none with a method {kind.method!r}"
    if class_name and class_name not in found:
        raise PluginError(f"{str(path)!r} has no {kind.name} {class_name!r}; it has: {choice}")
    if not class_name and len(found) != 1:
        raise PluginError(
            f"{str(path)!r} must define one {kind.name} or be named as {path}:Class; it has: "
            f"{choice}"
        )
    chosen = found[class_name or next(iter(found))]
    _checked_name(chosen, f"{kind.name} {str(path)!r}")
    return chosen


def _load(path: Path) -> ModuleType:
    return guarded(f"file {str(path)!r} cannot be imported", lambda: load_file(path), path)


def _plugin_classes(kind: Kind, module: ModuleType, path: Path) -> dict[str, type[Any]]:
    """Classes with the method of a kind, by name; where some have a ``name``, only those."""
    what = f"file {str(path)!r}"
    found = {
        name: member
        for name, member in list(vars(module).items())
        if issubclass(type(member), type)
        and type.__getattribute__(member, "__module__") == module.__name__
        and _has_method(kind, member, what)
    }
    named = {n: one for n, one in found.items() if attribute(one, "name", what) is not None}
    return named or found


def _has_method(kind: Kind, found: type[Any], what: str) -> bool:
    return callable(attribute(found, kind.method, what))


def _checked_name(found: type[Any], what: str) -> str:
    name = attribute(found, "name", what)
    if name is None:
        raise PluginError(f'{what} has no name: give its class an attribute name = "..."')
    if type(name) is not str or not name.strip():
        shown = repr(name) if type(name) is str else f"a {type_name(name)}"
        raise PluginError(f"{what} has {shown} for a name: it has to be a text that is not empty")
    if len(name) > _LONGEST_NAME or not name.isprintable():
        raise PluginError(
            f"{what} has the name {name[:_LONGEST_NAME]!r}: it has to be at most {_LONGEST_NAME} "
            "printable characters on one line"
        )
    return name


def _declaration(kind: Kind, plugin: Any, what: str) -> dict[str, str | float | bool]:
    found = {name: attribute(plugin, name, what) for name in kind.declares}
    if found.get("description", "") is None:
        found["description"] = _first_paragraph(attribute(plugin, "__doc__", what))
    for name, value in found.items():
        if type(value) not in (str, int, float, bool, type(None)):
            raise PluginError(
                f"{kind.name} {what!r} declares {name!r} as a {type_name(value)}: it has "
                "to be a text, a number, a truth value or None"
            )
        most = _LONGEST_DESCRIPTION if name == "description" else _LONGEST_NAME
        if type(value) is str and (len(value) > most or not value.isprintable()):
            raise PluginError(
                f"{kind.name} {what!r} declares {name!r} as {value[:_LONGEST_NAME]!r}: at most "
                f"{most} printable characters on one line"
            )
    return {name: value for name, value in found.items() if value is not None}


def _first_paragraph(doc: object) -> str:
    text = doc.strip().split("\n\n")[0] if type(doc) is str else ""
    plain = "".join(c if c.isprintable() else " " for c in text[:_LONGEST_DESCRIPTION])
    return " ".join(plain.split())

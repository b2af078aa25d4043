"""Plugins: estimators, scenarios, sensors and metrics, from this package and from others.

A plugin is a class with a class attribute ``name`` and the method of its kind. The arguments of its
constructor are its parameters. It is

- built in: a file with its name in the folder of its kind;
- installed: an entry point with its name in the group of its kind;
- in a file: ``path.py:ClassName``, or ``path.py`` if the file defines only one.
"""

import inspect
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache, lru_cache
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from olne_bench.errors import UserError
from olne_bench.plugin_files import at_home, load_file, module_name

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

_MOST_CHARACTERS = 1000  # of a message
_LONGEST_NAME = 100
_LONGEST_DESCRIPTION = 300
_PACKAGE = Path(__file__).parent

T = TypeVar("T")

_loadable: ContextVar[frozenset[str] | None] = ContextVar("loadable", default=None)


@contextmanager
def loading(*references: str) -> Iterator[None]:
    """Within this context, the plugins that are imported are built-in ones and these, no others.

    So a name that a file of data holds never runs code that its user has not named.
    """
    token = _loadable.set(frozenset(_home(reference) for reference in references))
    try:
        yield
    finally:
        _loadable.reset(token)


@dataclass(frozen=True)
class Kind:
    """A kind of plugin.

    Attributes:
        name: name in messages.
        package: package whose modules are the built-in plugins of this kind.
        method: method that makes a class a plugin of this kind.
        declares: attributes that tables and pages need to know.
    """

    name: str
    package: str
    method: str
    declares: tuple[str, ...] = ()

    @property
    def group(self) -> str:
        """Group of entry points."""
        return f"olne_bench.{self.name}s"


ESTIMATOR = Kind("estimator", "olne_bench.estimators", "estimate")
SCENARIO = Kind("scenario", "olne_bench.envs.scenarios", "draw")
SENSOR = Kind("sensor", "olne_bench.envs.sensors", "layers")
METRIC = Kind(
    "metric",
    "olne_bench.bench.judge.metrics",
    "score",
    declares=(
        *("label", "unit", "worst", "needs_prediction", "gated", "compared"),
        *("summary", "negligible", "description"),
    ),
)
KINDS = (ESTIMATOR, SCENARIO, SENSOR, METRIC)


class PluginError(UserError, ValueError):
    """A plugin that is unknown, cannot be imported, or refuses its parameters; one line."""

    def __init__(self, message: str) -> None:
        line = " ".join("".join(c if c.isprintable() else " " for c in message).split())
        cut = line if len(line) <= _MOST_CHARACTERS else line[: _MOST_CHARACTERS - 4] + " ..."
        super().__init__(cut)


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


def names(kind: Kind) -> list[str]:
    """Names of the built-in and the installed plugins of a kind, without importing them."""
    return sorted({*_built_in(kind), *_installed(kind)})


def is_file(reference: str) -> bool:
    """Whether a reference names a file rather than a known plugin."""
    return _split(reference) is not None


def is_built_in(kind: Kind, reference: str) -> bool:
    """Whether a reference names a plugin of this package."""
    return not is_file(reference) and reference in _built_in(kind)


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
    known = ", ".join(sorted(_built_in(kind)))
    raise PluginError(
        f"{place} names the {kind.name} {name[:_LONGEST_NAME]!r}, and a file can only name a "
        f"built-in one: {known}; to use another, name it with {option}"
    )


def absolute(reference: str) -> str:
    """The reference in a form that can be used from any folder.

    Raises:
        PluginError: on an impossible path.
    """
    parts = _split(reference)
    if parts is None:
        return reference
    path, class_name = parts
    return f"{_resolved(path)}:{class_name}" if class_name else str(_resolved(path))


def file_of(reference: str) -> Path | None:
    """The file that a reference names, an absolute path; None for the name of a known plugin.

    Raises:
        PluginError: on an impossible path.
    """
    parts = _split(reference)
    return None if parts is None else _resolved(parts[0])


def source(kind: Kind, reference: str) -> tuple[str, Path]:
    """Name and file of the module that defines a plugin, found without running it.

    Raises:
        PluginError: if the plugin is unknown or its module has no file.
    """
    parts = _split(reference)
    if parts is not None:
        path = _file(kind.name, parts[0])
        return module_name(path), path
    place = _find(kind, reference)
    if isinstance(place, Path):
        return f"{kind.package}.{place.stem}", place
    path = _module_file(kind, place)
    return place.module, path


def find_class(kind: Kind, reference: str) -> type[Any]:
    """Import a plugin's class.

    Args:
        kind: kind of the plugin.
        reference: a name from ``names(kind)``, or ``path.py`` / ``path.py:ClassName``.

    Raises:
        PluginError: with one line that names the alternatives, or file and line of the cause.
    """
    if not isinstance(reference, str):
        raise _unknown(kind, reference)
    if not is_built_in(kind, reference):
        _refuse_unnamed(reference)
    parts = _split(reference)
    if parts is not None:
        return _class_from_file(kind, _file(kind.name, parts[0]), parts[1])
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
            refusal = f"{what} refuses its parameters: {_text(error)}"
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
    parts = _split(reference)
    if parts is None:
        raise PluginError(f"{reference!r} is not a plugin file: expected path.py or path.py:Class")
    _refuse_unnamed(reference)
    path, class_name = _file("plugin", parts[0]), parts[1]
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
            several=kind == ESTIMATOR and _attribute(plugin, "several", reference) is True,
            declaration=_declaration(kind, plugin, reference),
        )
    except PluginError as error:
        return Description(kind=kind.name if kind else "", reference=reference, error=str(error))


def import_file(reference: str) -> None:
    """Import a plugin's file, so that objects of its classes can be unpickled.

    Other plugins are imported by pickle itself. Raises whatever the file raises.

    Raises:
        PluginError: outside of ``loading`` for it.
    """
    _refuse_unnamed(reference)
    place = _split(reference)
    if place is not None:
        load_file(_resolved(place[0]))


def parameter_names(found: type[Any]) -> list[str]:
    """Names of the parameters of a plugin's class; empty if it has no readable signature."""
    try:
        return [str(name) for name in inspect.signature(found).parameters]
    except BaseException:  # this may run foreign code
        return []


def takes_seed(scenario: Any) -> bool:
    """Whether a scenario is a family: each seed draws another member.

    Its ``draw`` takes a seed then. Where that depends on its options, the attribute ``fixed`` says
    so.
    """
    try:
        seeded = "seed" in inspect.signature(scenario.draw).parameters
        return seeded and not getattr(scenario, "fixed", False)
    except BaseException:  # this may run foreign code
        return False


def describe_foreign_error(error: BaseException, file: Path | None = None) -> str:
    """What was raised, and where; the only foreign code it runs is the exception's ``__str__``.

    Args:
        error: what was raised.
        file: file that was being imported, as errors that Python finds in its text do not always
            name it: before Python 3.11.4, one of them was a ``ValueError``.
    """
    text, where = _text(error), ""
    trace = error.__traceback__
    while trace is not None:
        where = f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}"
        trace = trace.tb_next
    if where.startswith("<frozen importlib"):
        where = str(file or where)
    if isinstance(error, SyntaxError) and type(error).__module__ == "builtins":
        place = f"{error.filename}:{error.lineno}" if error.filename else ""
        text, where = str(error.msg), place or str(file or where)  # its text has the place too
    return f"{_type_name(error)}: {text[:600]} ({where})"


def _home(reference: str) -> str:
    """The absolute path of a reference's file; the reference itself if it is a name."""
    parts = _split(reference)
    return reference if parts is None else str(_resolved(parts[0]))


def _refuse_unnamed(reference: str) -> None:
    loadable = _loadable.get()
    if loadable is not None and isinstance(reference, str) and _home(reference) not in loadable:
        raise PluginError(
            f"plugin {reference!r} is not loaded: only what the command line names is (--plugin)"
        )


def _split(reference: str) -> tuple[str, str] | None:
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


def _file(what: str, path: str) -> Path:
    if "\0" in path or not os.path.isfile(path):  # noqa: PTH113 (Path raises on long names)
        raise PluginError(f"no {what} file {path!r}")
    return _resolved(path)


@cache
def _built_in(kind: Kind) -> dict[str, Path]:
    """Files that define a plugin of their own name, found in their text, as imports are slow."""
    folder = _PACKAGE.joinpath(*kind.package.split(".")[1:])
    line = r'^    name(: ClassVar\[str\])? = "{}"$'
    return {
        path.stem: path
        for path in sorted(folder.glob("*.py"))
        if re.search(line.format(path.stem), path.read_text(encoding="utf-8"), re.MULTILINE)
    }


def _installed(kind: Kind) -> dict[str, tuple[EntryPoint, ...]]:
    return _entry_points(kind.group, tuple(sys.path))


@lru_cache(maxsize=64)  # asked for with every trial
def _entry_points(group: str, _path: tuple[str, ...]) -> dict[str, tuple[EntryPoint, ...]]:
    found: dict[str, dict[str, EntryPoint]] = {}
    for point in entry_points(group=group):
        found.setdefault(point.name, {})[point.value] = point
    return {name: tuple(points.values()) for name, points in found.items()}


def _find(kind: Kind, reference: str) -> Path | EntryPoint:
    """Where a known plugin is."""
    if not isinstance(reference, str):
        raise _unknown(kind, reference)
    built_in, installed = _built_in(kind).get(reference), _installed(kind).get(reference, ())
    if len(installed) + (built_in is not None) > 1:
        places = [f"{_owner(point)} ({point.value})" for point in installed]
        places = ["the built-in one"] * (built_in is not None) + places
        raise PluginError(
            f"there are {len(places)} {kind.name}s called {reference!r}: {', '.join(places)}; "
            "rename or uninstall one"
        )
    if built_in is not None:
        return built_in
    if installed:
        return installed[0]
    raise _unknown(kind, reference)


def _unknown(kind: Kind, reference: object) -> PluginError:
    known = names(kind)
    return PluginError(
        f"unknown {kind.name} {reference!r}; known are: {', '.join(known)}, "
        f"or a file path.py:ClassName{nearest(reference, known)}"
    )


def nearest(name: object, known: Iterable[str]) -> str:
    """The names that are most like another one, as the end of a message; empty if none is."""
    found = ", ".join(get_close_matches(str(name), [*known]))
    return f"; nearest: {found}" if found else ""


def _owner(point: EntryPoint) -> str:
    return f"of {point.dist.name}" if point.dist else "of a package without a name"


@lru_cache(maxsize=64)  # asked for with every trial
def _known_class(kind: Kind, reference: str, _path: tuple[str, ...]) -> type[Any]:
    place = _find(kind, reference)
    if isinstance(place, Path):
        module = import_module(f"{kind.package}.{place.stem}")
        classes = [c for c in vars(module).values() if isinstance(c, type)]
        return next(
            c for c in classes if c.__module__ == module.__name__ and _is(c, kind, reference)
        )
    what = f"{kind.name} {reference!r} {_owner(place)}"
    loaded = _guarded(f"{what} cannot be imported", place.load)
    if not issubclass(type(loaded), type):
        raise PluginError(f"{what} ({place.value}) is not a class")
    if not _has_method(kind, loaded, what):
        raise PluginError(f"{what} ({place.value}) has no method {kind.method!r}")
    name = _checked_name(loaded, what)
    if name != reference:
        raise PluginError(
            f"{what} is installed under another name than its class has: {name!r}; let them agree"
        )
    return loaded


def _is(found: type[Any], kind: Kind, name: str) -> bool:
    return getattr(found, "name", None) == name and hasattr(found, kind.method)


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
    return _guarded(f"file {str(path)!r} cannot be imported", lambda: load_file(path), path)


def _plugin_classes(kind: Kind, module: ModuleType, path: Path) -> dict[str, type[Any]]:
    """Classes of a file that have the method of a kind, by name.

    If some of them have a ``name``, those without one are helpers and left out.
    """
    what = f"file {str(path)!r}"
    own = [
        (name, member)
        for name, member in list(vars(module).items())
        if issubclass(type(member), type)
        and type.__getattribute__(member, "__module__") == module.__name__
    ]
    found = {name: member for name, member in own if _has_method(kind, member, what)}
    named = {
        name: member
        for name, member in found.items()
        if _attribute(member, "name", what) is not None
    }
    return named or found


def _has_method(kind: Kind, found: type[Any], what: str) -> bool:
    return callable(_attribute(found, kind.method, what))


def _attribute(owner: object, name: str, what: str) -> Any:
    """An attribute, None if absent; a metaclass or property may raise anything."""
    return _guarded(f"{what}: {name!r} cannot be read", lambda: getattr(owner, name, None))


def _checked_name(found: type[Any], what: str) -> str:
    name = _attribute(found, "name", what)
    if name is None:
        raise PluginError(f'{what} has no name: give its class an attribute name = "..."')
    if type(name) is not str or not name.strip():
        shown = repr(name) if type(name) is str else f"a {_type_name(name)}"
        raise PluginError(f"{what} has {shown} for a name: it has to be a text that is not empty")
    if len(name) > _LONGEST_NAME or not name.isprintable():
        raise PluginError(
            f"{what} has the name {name[:_LONGEST_NAME]!r}: it has to be at most {_LONGEST_NAME} "
            "printable characters on one line"
        )
    return name


def _declaration(kind: Kind, plugin: Any, what: str) -> dict[str, str | float | bool]:
    found = {name: _attribute(plugin, name, what) for name in kind.declares}
    if found.get("description", "") is None:
        found["description"] = _first_paragraph(_attribute(plugin, "__doc__", what))
    for name, value in found.items():
        if type(value) not in (str, int, float, bool, type(None)):
            raise PluginError(
                f"{kind.name} {what!r} declares {name!r} as a {_type_name(value)}: it has "
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


def _guarded(what: str, call: Callable[[], T], file: Path | None = None) -> T:
    """Run foreign code; turn what it raises into a ``PluginError`` of one line with its place."""
    try:
        return call()
    except BaseException as error:
        raise PluginError(f"{what}: {describe_foreign_error(error, file)}") from error


def _type_name(value: object) -> str:
    name: str = type.__dict__["__name__"].__get__(type(value))  # whatever its metaclass says
    return name


def _text(error: BaseException) -> str:
    try:
        return str(error)
    except BaseException:  # the exception's class may be foreign code too
        return "no text"


def _module_file(kind: Kind, point: EntryPoint) -> Path:
    """File of an entry point's module, without importing the packages that contain it."""
    what = f"{kind.name} {point.name!r} {_owner(point)}"
    places: list[str] | None = None
    full = ""
    spec = None
    module = _guarded(f"{what} does not refer to a class", lambda: point.module)
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

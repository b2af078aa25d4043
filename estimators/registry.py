"""Where estimators come from: this folder, installed plugins, and files.

- Every module in this folder that defines a class with an ``estimate`` method is a built-in; the
  class attribute ``name`` is what it is called.
- An installed package adds one through the entry-point group ``estimators``.
- ``path/to/file.py:ClassName`` names one in a file; without ``:ClassName`` the file has to define
  exactly one.
"""

import importlib.util
import inspect
import sys
import traceback
import zlib
from collections.abc import Mapping
from functools import cache, lru_cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

import olne_bench.estimators as estimators
from olne_bench.estimators.protocol import Estimator

ENTRY_POINT_GROUP = "olne_bench.estimators"
_NOT_ESTIMATORS = {"parameters", "protocol", "registry"}


class EstimatorError(ValueError):
    """An estimator that is unknown, cannot be imported, or refuses its parameters."""


def estimator_names() -> list[str]:
    """Names of the built-in and the installed estimators."""
    return sorted({*_built_in(), *_installed()})


def load_estimator(reference: str, parameters: Mapping[str, Any] | None = None) -> Estimator:
    """Make an estimator.

    Args:
        reference: a name from ``estimator_names()``, or ``path.py`` / ``path.py:ClassName``.
        parameters: keyword arguments of its class.

    Raises:
        EstimatorError: with one line that names the alternatives, or file and line of the cause.
    """
    estimator_class = _find_class(reference)
    try:
        return estimator_class(**(parameters or {}))
    except (TypeError, ValueError) as error:
        known = ", ".join(_parameter_names(estimator_class)) or "none"
        raise EstimatorError(
            f"estimator {reference!r} refuses its parameters: {error}; its parameters: {known}"
        ) from error
    except (Exception, SystemExit) as error:
        raise EstimatorError(
            f"estimator {reference!r} cannot be made: {_describe(error)}"
        ) from error


def estimator_label(reference: str) -> str:
    """The name that tables show for a reference: the class attribute ``name``, or its name.

    Raises:
        EstimatorError: as ``load_estimator``, and on a ``name`` that is no text or empty.
    """
    estimator_class = _find_class(reference)
    label = getattr(estimator_class, "name", estimator_class.__name__)
    if not (isinstance(label, str) and label.strip()):
        raise EstimatorError(
            f"estimator {reference!r} has the name {label!r}: its class attribute 'name' has to be "
            "a text that is not empty, or absent"
        )
    return label


def estimator_source(reference: str) -> tuple[str, Path]:
    """Name and file of the module that defines an estimator.

    Raises:
        EstimatorError: as ``load_estimator`` does.
    """
    estimator_class = _find_class(reference)
    module = sys.modules[estimator_class.__module__]
    if not module.__file__:
        raise EstimatorError(f"estimator {reference!r} has no file: {module!r}")
    return module.__name__, Path(module.__file__)


def is_file_reference(reference: str) -> bool:
    """Whether a reference names a file rather than a known estimator."""
    return reference.partition(":")[0].endswith(".py")


def is_built_in(reference: str) -> bool:
    """Whether a reference names an estimator of this package."""
    return not is_file_reference(reference) and reference in _built_in()


def absolute_reference(reference: str) -> str:
    """The reference as it can be used from another folder as well."""
    if not is_file_reference(reference):
        return reference
    path, colon, class_name = reference.partition(":")
    return f"{Path(path).resolve()}{colon}{class_name}"


def _find_class(reference: str) -> type[Any]:
    if is_file_reference(reference):
        path, _, class_name = reference.partition(":")
        if not Path(path).is_file():
            raise EstimatorError(f"no estimator file {path!r}")
        return _class_from_file(Path(path).resolve(), class_name)
    built_in, installed = _built_in(), _installed()
    if reference in built_in:
        return built_in[reference]
    if reference in installed:
        loaded = _guarded_import(f"plugin {reference!r}", installed[reference].load)
        if not hasattr(loaded, "estimate"):
            raise EstimatorError(f"plugin {reference!r} ({loaded!r}) has no method 'estimate'")
        return loaded
    raise EstimatorError(
        f"unknown estimator {reference!r}; known are: {', '.join(estimator_names())}, "
        "or a file path.py:ClassName"
    )


@cache  # asked for with every trial, as is the next one
def _built_in() -> dict[str, type[Any]]:
    modules = [
        import_module(f"{estimators.__name__}.{module.name}")
        for module in iter_modules(estimators.__path__)
        if module.name not in _NOT_ESTIMATORS
    ]
    classes = [found for module in modules for found in _classes_of(module)]
    return {found.name: found for found in classes}


@cache
def _installed() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}


@lru_cache(maxsize=64)  # so that what a plugin caches in its module lasts
def _class_from_file(path: Path, class_name: str) -> type[Any]:
    # The name is unique to the path so that two plugins called plugin.py do not meet; the module
    # has to be listed for dataclasses and pickle to find it.
    name = f"olne_bench_plugin_{path.stem}_{zlib.crc32(bytes(path)):08x}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    _guarded_import(f"file {str(path)!r}", lambda: spec.loader.exec_module(module), path)
    found = {c.__name__: c for c in _classes_of(module)}
    if class_name:
        if class_name not in found:
            choice = ", ".join(found) or "none with a method 'estimate'"
            raise EstimatorError(f"{str(path)!r} has no estimator {class_name!r}; it has: {choice}")
        return found[class_name]
    if len(found) != 1:
        choice = ", ".join(found) or "none"
        raise EstimatorError(
            f"{str(path)!r} must define one estimator or be named as {path}:Class; it has: {choice}"
        )
    return next(iter(found.values()))


def _classes_of(module: ModuleType) -> list[type[Any]]:
    return [
        member
        for _, member in inspect.getmembers(module, inspect.isclass)
        if member.__module__ == module.__name__ and callable(getattr(member, "estimate", None))
    ]


def _guarded_import(what: str, load: Any, file: Path | None = None) -> Any:
    """Run an import of foreign code; turn whatever it raises into one line with its place."""
    try:
        return load()
    except (Exception, SystemExit) as error:
        raise EstimatorError(f"{what} cannot be imported: {_describe(error, file)}") from error


def _describe(error: BaseException, file: Path | None = None) -> str:
    """What was raised, and where; some syntax errors do not know of which file they are."""
    text, place = str(error), traceback.extract_tb(error.__traceback__)[-1]
    where = f"{place.filename}:{place.lineno}"
    if isinstance(error, SyntaxError) and error.filename:
        text, where = error.msg, f"{error.filename}:{error.lineno}"  # its text has the place too
    elif isinstance(error, SyntaxError) and file is not None:
        where = str(file)
    return f"{type(error).__name__}: {text} ({where})"


def _parameter_names(estimator_class: type[Any]) -> list[str]:
    return [name for name in inspect.signature(estimator_class).parameters if name != "self"]

"""Kinds of plugins, and messages on plugins that cannot be used."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from olne_bench.errors import UserError

_MOST_CHARACTERS = 1000  # of a message

T = TypeVar("T")


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
_OF_METRICS = (
    *("label", "unit", "worst", "needs_prediction", "gated", "compared"),
    *("summary", "negligible", "description", "radius"),
)
METRIC = Kind("metric", "olne_bench.bench.judge.metrics", "score", declares=_OF_METRICS)
KINDS = (ESTIMATOR, SCENARIO, SENSOR, METRIC)


class PluginError(UserError, ValueError):
    """A plugin that is unknown, cannot be imported, or refuses its parameters; one line."""

    def __init__(self, message: str) -> None:
        line = " ".join("".join(c if c.isprintable() else " " for c in message).split())
        cut = line if len(line) <= _MOST_CHARACTERS else line[: _MOST_CHARACTERS - 4] + " ..."
        super().__init__(cut)


def describe_foreign_error(error: BaseException, file: Path | None = None) -> str:
    """What was raised, and where; the only foreign code it runs is the exception's ``__str__``.

    Args:
        error: what was raised.
        file: file that was being imported, as errors that Python finds in its text do not always
            name it: before Python 3.11.4, one of them was a ``ValueError``.
    """
    text, where = text_of(error), ""
    trace = error.__traceback__
    while trace is not None:
        where = f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}"
        trace = trace.tb_next
    if where.startswith("<frozen importlib"):
        where = str(file or where)
    if isinstance(error, SyntaxError) and type(error).__module__ == "builtins":
        place = f"{error.filename}:{error.lineno}" if error.filename else ""
        text, where = str(error.msg), place or str(file or where)  # its text has the place too
    return f"{type_name(error)}: {text[:600]} ({where})"


def guarded(what: str, call: Callable[[], T], file: Path | None = None) -> T:
    """Run foreign code; turn what it raises into a ``PluginError`` of one line with its place."""
    try:
        return call()
    except BaseException as error:
        raise PluginError(f"{what}: {describe_foreign_error(error, file)}") from error


def attribute(owner: object, name: str, what: str) -> Any:
    """An attribute, None if absent; a metaclass or property may raise anything."""
    return guarded(f"{what}: {name!r} cannot be read", lambda: getattr(owner, name, None))


def type_name(value: object) -> str:
    """Name of a value's type, whatever its metaclass says."""
    name: str = type.__dict__["__name__"].__get__(type(value))
    return name


def text_of(error: BaseException) -> str:
    """Text of an exception, whose class may be foreign code too."""
    try:
        return str(error)
    except BaseException:
        return "no text"

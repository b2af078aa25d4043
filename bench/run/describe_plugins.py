"""Describe plugins in processes that may hang or die.

The driver imports no plugin. What it needs to know about one is a ``Description``, plain data.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from olne_bench import plugins
from olne_bench.bench.process.child import (
    ATTEMPTS,
    Child,
    ChildError,
    DiedError,
    RaisedError,
    TimedOutError,
)
from olne_bench.bench.process.messages import StartError
from olne_bench.errors import UserError
from olne_bench.plugins import Description, Kind

#: Time that importing and constructing one plugin may take [s].
LOAD_LIMIT = 60.0
#: Memory that this may take [bytes].
LOAD_MEMORY = 4 * 2**30

#: Kind (None if unknown), reference and parameters of a plugin.
Request = tuple[Kind | None, str, Mapping[str, Any]]


def describe_all(requests: Sequence[Request], hidden: Path | None = None) -> list[Description]:
    """Describe plugins: built-in ones in this process, foreign ones in one process per file.

    Returns:
        One description per request; its ``error`` is one line if something is wrong.
    """
    children: dict[str, Child] = {}
    try:
        return [_describe(children, hidden, *request) for request in requests]
    finally:
        for child in children.values():
            child.stop()


def _describe(
    children: dict[str, Child],
    hidden: Path | None,
    kind: Kind | None,
    reference: str,
    parameters: Mapping[str, Any],
) -> Description:
    if kind is not None and plugins.is_built_in(kind, reference):
        return plugins.describe(kind, reference, parameters)
    home = plugins.absolute(reference).rpartition(".py:")[0] or reference
    child = children.setdefault(
        home, Child(restricted=True, memory=LOAD_MEMORY, plugins=[reference], hidden=hidden)
    )
    try:
        return _ask(child, kind, plugins.absolute(reference), dict(parameters))
    except StartError:
        raise
    except TimedOutError:
        reason = f"it takes more than {LOAD_LIMIT:g} s"
    except (ChildError, RaisedError, UserError) as error:
        reason = str(error)
    what = kind.name if kind else "plugin"
    return Description(
        kind=what, reference=reference, error=f"{what} {reference!r} cannot be loaded: {reason}"
    )


def _ask(child: Child, *question: Any) -> Description:
    """Describe a plugin in a process; if it is killed from outside, another process is asked."""
    for attempt in range(ATTEMPTS):
        try:
            found: Description = child.call(
                plugins.describe, *question, kind=Description, seconds=LOAD_LIMIT
            )
            return found
        except DiedError as error:
            if not error.outside or attempt == ATTEMPTS - 1:
                raise
    raise AssertionError

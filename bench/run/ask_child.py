"""Ask a child process about a foreign scenario, which may take the process down."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from olne_bench.bench.process.child import Child, ChildError, RaisedError, StartError
from olne_bench.bench.run.describe_plugins import LOAD_LIMIT, LOAD_MEMORY
from olne_bench.errors import UserError

T = TypeVar("T")


def asked(
    function: Callable[..., T],
    *about: Any,
    kind: type[T],
    plugins: Sequence[str],
    hidden: Path | None,
) -> T | None:
    """The answer of a function; None if the scenario's draw fails, which its trials will show.

    Args:
        function: called in the child process.
        about: its arguments.
        kind: type of the answer.
        plugins: references of the plugins that the child process runs.
        hidden: folder that foreign code cannot read.

    Raises:
        StartError: if no process can be started.
    """
    child = Child(restricted=True, memory=LOAD_MEMORY, plugins=plugins, hidden=hidden)
    try:
        found: T = child.call(function, *about, kind=kind, seconds=LOAD_LIMIT)
    except StartError:
        raise
    except (ChildError, RaisedError, UserError):
        return None
    finally:
        child.stop()
    return found

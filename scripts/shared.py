"""What scripts share: one thread, command lines and times.

Scripts import this module first, so that NumPy is imported after its threads are limited.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse
import inspect
import sys
import time
from collections.abc import Callable
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")


def command(main: Callable[..., object]) -> None:
    """Run a script: parameters of ``main`` are arguments, its module's docstring is the help.

    A parameter without a default is required. ``bool`` is a flag, ``tuple`` several words, and
    ``Annotated[str, NAMES]`` one of some names. What ``main`` returns is the exit code.
    """
    parser = argparse.ArgumentParser(
        description=sys.modules[main.__module__].__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        argument_default=argparse.SUPPRESS,
    )
    hints = get_type_hints(main, include_extras=True)
    for name, parameter in inspect.signature(main).parameters.items():
        needed = parameter.default is parameter.empty
        flag = name if needed else "--" + name.replace("_", "-")
        parser.add_argument(flag, **_how(hints[name], needed, parameter.default))
    sys.exit(main(**vars(parser.parse_args())))  # type: ignore[arg-type]  # an int, a bool or None


def _how(hint: Any, needed: bool, default: object) -> dict[str, Any]:
    """How the parser reads a parameter of a type."""
    told: dict[str, Any] = {} if needed else {"help": f"default: {default}"}
    if hint is bool:
        return told | {"action": "store_true"}
    if get_origin(hint) is tuple:
        inner, _ = get_args(hint)
        several = {"nargs": "+"} if needed else {"nargs": "+", "action": "extend"}
        return told | several | _how(inner, True, None)
    if get_origin(hint) is Annotated:
        inner, names = get_args(hint)
        return told | {"choices": list(names)} | _how(inner, True, None)
    parts = [part for part in get_args(hint) if part is not type(None)]
    return told | {"type": parts[0] if parts else hint}


def timed(solve: Callable[[], T]) -> tuple[float, T]:
    """Processor time of a call [s], and its result."""
    started = time.process_time()
    result = solve()
    return time.process_time() - started, result

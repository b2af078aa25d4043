"""What scripts share: one thread, command lines, times and tables.

Scripts import this module first, so that NumPy is imported after its threads are limited.
"""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse
import inspect
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, ParamSpec, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")
P = ParamSpec("P")


def command(*mains: Callable[..., object]) -> None:
    """Run a script: parameters of its function are arguments, its module's docstring is the help.

    Of several functions, each is a subcommand with its own docstring as help. A parameter without
    a default is required. ``bool`` is a flag, ``tuple`` several words, and ``Annotated[str,
    NAMES]`` one of some names. What the function returns is the exit code.
    """
    form: dict[str, Any] = {
        "formatter_class": argparse.RawDescriptionHelpFormatter,
        "argument_default": argparse.SUPPRESS,
    }
    whole = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__, **form)
    parts = whole.add_subparsers(metavar="COMMAND", required=True) if len(mains) > 1 else None
    for main in mains:
        told = inspect.getdoc(main) or ""
        parser = whole
        if parts:
            name, first = main.__name__.replace("_", "-"), told.splitlines()[0]
            parser = parts.add_parser(name, help=first, description=told, **form)
        hints = get_type_hints(main, include_extras=True)
        for name, parameter in inspect.signature(main).parameters.items():
            needed = parameter.default is parameter.empty
            flag = name if needed else "--" + name.replace("_", "-")
            parser.add_argument(flag, **_how(hints[name], needed, parameter.default))
        parser.set_defaults(main=main)
    given = vars(whole.parse_args())
    sys.exit(given.pop("main")(**given))


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


def timed(solve: Callable[P, T], *given: P.args, **named: P.kwargs) -> tuple[float, T]:
    """Processor time of a call [s], and its result."""
    started = time.process_time()
    result = solve(*given, **named)
    return time.process_time() - started, result


def clock() -> tuple[float, float]:
    """Processor time, which other programs disturb little, and wall-clock time [s]."""
    return time.process_time(), time.perf_counter()


def show(rows: Iterable[Mapping[str, object]]) -> None:
    """Print rows as they come, below their heads: words on the left, numbers on the right."""
    heads: list[str] = []
    for row in rows:
        cells = [f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()]
        if list(row) != heads:
            heads = list(row)
            widths = [max(len(head), len(cell)) for head, cell in zip(heads, cells, strict=True)]
            left = [cell[:1].isalpha() for cell in cells]
            widths = [n + 6 if word else max(n, 7) for n, word in zip(widths, left, strict=True)]
            _print_line(heads, widths, left)
        _print_line(cells, widths, left)


def _print_line(cells: list[str], widths: list[int], left: list[bool]) -> None:
    parts = zip(cells, widths, left, strict=True)
    shown = (cell.ljust(n) if word else cell.rjust(n) for cell, n, word in parts)
    print("  ".join(shown).rstrip(), flush=True)

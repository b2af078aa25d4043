"""Rules of plugins, as checks that an author can run.

Checks run in a child process, like a trial. A check that dies fails, and the others continue.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from olne_bench.bench.conformance import NonConformance, Weakness
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.process.child import (
    Child,
    ChildError,
    LeftProcessesError,
    MisspokeError,
    RaisedError,
    TimedOutError,
)
from olne_bench.bench.process.messages import StartError
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.bench.text import one_line
from olne_bench.errors import UserError
from olne_bench.plugins import (
    ESTIMATOR,
    KINDS,
    Kind,
    at_home,
    describe_foreign_error,
    is_file,
    make,
    names,
)


@dataclass(frozen=True)
class Check:
    """One check of one plugin."""

    kind: str
    name: str
    reference: str
    parameters: Mapping[str, Any]
    budget: float  # of each estimate [s], which the estimator is given
    time_limit: float  # after which the check is killed [s]


def checks_of(kind: Kind) -> Mapping[str, Callable[..., None]]:
    """Checks by name, in the order in which they run; they raise the exceptions of ``findings``.

    A check takes the plugin; a check of estimators also takes the time limit [s] of an estimate.
    """
    # Only the module of this kind is imported, as each import takes a while.
    module = import_module(f"olne_bench.bench.conformance.{kind.name}_checks")
    checks: Mapping[str, Callable[..., None]] = module.CHECKS
    return checks


def identify(
    reference: str, parameters: Mapping[str, Any] | None = None, kind: str | None = None
) -> Kind:
    """The kind of the plugin that a reference names; a file is imported in another process."""
    kinds = [one for one in KINDS if kind in (None, one.name)]
    found = kinds if is_file(reference) else [one for one in kinds if reference in names(one)]
    if not found:
        known = "; ".join(f"{one.name}s: {', '.join(names(one)) or 'none'}" for one in kinds)
        raise UserError(
            f"unknown plugin {reference!r}; known are: {known}; or a file path.py:Class"
        )
    if len(found) > 1 and not is_file(reference):
        choice = " or ".join(f"--kind {one.name}" for one in found)
        raise UserError(f"there are several plugins called {reference!r}: choose with {choice}")
    named = found[0].name if len(found) == 1 else ""
    asked = found[0] if named else None
    (description,) = describe_all([(asked, reference, parameters or {})])
    if description.error:
        raise UserError(description.error)
    return next(one for one in KINDS if one.name == description.kind)


def run_checks(
    kind: Kind, reference: str, parameters: Mapping[str, Any], *, budget: float, memory: int
) -> Iterator[tuple[str, Outcome]]:
    """Run all checks of a plugin; yield the name and outcome of each.

    The outcome is ``ok`` if the check passes, with a message if the plugin is weak. A check that
    hangs is the last one: the others would hang as well. An estimate has ``budget`` [s], the
    process ``memory`` [bytes].
    """
    limit = 4 * budget + 60  # some make several estimates, and the first builds solvers
    checks = [
        Check(kind.name, name, reference, parameters, budget, limit) for name in checks_of(kind)
    ]
    return _in_process(checks, memory)


def run_check(check: Check) -> Outcome:
    """Run a check in this process."""
    kind = next(one for one in KINDS if one.name == check.kind)
    try:
        plugin = make(kind, check.reference, check.parameters)
        with at_home(plugin):
            budget = (check.budget,) if kind == ESTIMATOR else ()
            checks_of(kind)[check.name](plugin, *budget)
    except NonConformance as finding:
        return Outcome("invalid", one_line(str(finding)))
    except Weakness as finding:
        return Outcome("ok", one_line(str(finding)))
    except BaseException as error:  # foreign code may raise anything
        return Outcome("crash", one_line(describe_foreign_error(error)))
    return Outcome("ok")


def _in_process(checks: list[Check], memory: int | None) -> Iterator[tuple[str, Outcome]]:
    files = [check.reference for check in checks]
    child = Child(log=Path(os.devnull), memory=memory, restricted=True, plugins=files)
    try:
        for check in checks:
            outcome = _outcome(child, check)
            yield check.name, outcome
            if outcome.status == "timeout":
                return
    finally:
        child.stop()


def _outcome(child: Child, check: Check) -> Outcome:
    try:
        outcome: Outcome = child.call(run_check, check, kind=Outcome, seconds=check.time_limit)
    except TimedOutError:
        return Outcome("timeout", f"killed after {check.time_limit:g} s")
    except (LeftProcessesError, MisspokeError) as error:
        return Outcome("invalid", str(error))
    except StartError:
        raise
    except (ChildError, RaisedError, UserError) as error:
        return Outcome("crash", str(error))
    return outcome

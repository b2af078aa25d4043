"""Parts of suites, and suites that the options of a run change.

Levels that a suite does not have take the place of its own. A changed suite has another name, so
that its rows are not taken for those of the suite. Its salt is the same: what both have in common
has the same draws and noise.
"""

import math
import shlex
from collections.abc import Iterable
from typing import Any

from olne_bench import plugins
from olne_bench.bench.plan.kinds import Rules
from olne_bench.bench.plan.learn import Describe, with_named
from olne_bench.bench.plan.load import check_suite
from olne_bench.bench.plan.suite import CHANGED, Suite
from olne_bench.bench.plan.values import Label, Seeds, Sigma, Strict, shown
from olne_bench.errors import UserError
from olne_bench.plugin_places import nearest

_LARGEST_SIGMA = 1e6
_KINDS = {"scenarios": plugins.SCENARIO, "sensors": plugins.SENSOR, "estimators": plugins.ESTIMATOR}


class Selection(Strict):
    """Which part of a suite to use; an empty field selects everything."""

    scenarios: tuple[Label, ...] = ()  # labels, as below
    sensors: tuple[Label, ...] = ()
    sigmas: tuple[Sigma, ...] = ()
    estimators: tuple[Label, ...] = ()
    seeds: Seeds | None = None  # number of noise draws to use, from the first on

    def __str__(self) -> str:
        """The selection as command-line options; empty if it selects everything."""
        chosen: dict[str, Iterable[object]] = {
            "scenario": self.scenarios,
            "sensor": self.sensors,
            "estimator": self.estimators,
            "sigma": self.sigmas,
            "seeds": () if self.seeds is None else (self.seeds,),
        }
        words = [w for name, values in chosen.items() for v in values for w in (f"--{name}", v)]
        return shlex.join(str(word) for word in words)


def select(suite: Suite, selection: Selection) -> Suite:
    """A part of a suite, with all that estimators are compared with, unless some of it is named."""
    scenarios, sensors, sigmas, estimators = (
        _named(suite, axis, getattr(selection, axis))
        for axis in ("scenarios", "sensors", "sigmas", "estimators")
    )
    if selection.seeds is not None and selection.seeds > suite.seeds:
        raise UserError(f"--seeds {selection.seeds}: suite {suite.name!r} has {suite.seeds}")
    kept = []
    for entry in suite.scenarios:
        own = tuple(s for s in suite.sigmas_of(entry) if s in sigmas)
        if own and entry.label in scenarios:
            kept.append(entry.model_copy(update={"sigmas": own}) if entry.sigmas else entry)
    if not kept:
        raise UserError(f"suite {suite.name!r} has no scenario with such noise levels: {selection}")
    if not estimators & {*suite.references}:
        estimators |= {*suite.references}
    return suite.model_copy(
        update={
            "scenarios": tuple(kept),
            "sensors": tuple(s for s in suite.sensors if s.label in sensors),
            "sigmas": tuple(s for s in suite.sigmas if s in sigmas),
            "estimators": tuple(e for e in suite.estimators if e.label in estimators),
        }
    )


def _named(suite: Suite, axis: str, wanted: Iterable[Any]) -> set[Any]:
    """What is wanted of a suite: labels or noise levels that it has, all if none is named."""
    known = suite.levels if axis == "sigmas" else [e.label for e in getattr(suite, axis)]
    for value in wanted:
        if value not in known:
            choice = ", ".join(str(item) for item in known)
            raise UserError(
                f"suite {suite.name!r} has no {axis[:-1]} {shown(value)}; it has: {choice}"
            )
    return set(wanted or known)


def changed(suite: Suite, selection: Selection, describe: Describe) -> Suite:
    """The suite in which a selection can be made.

    What of it the suite does not have replaces what it has; if it has all, it is not changed.
    """
    whole, replaced = suite, dict[str, Any]()
    for axis, kind in _KINDS.items():
        known = [entry.label for entry in getattr(suite, axis)]
        new = [name for name in getattr(selection, axis) if name not in known]
        if new:
            _check_names(suite, kind, new, known)
            whole = with_named(whole, kind, new, describe)
            replaced[axis] = getattr(selection, axis)
    whole = _with_sigmas(whole, selection.sigmas)
    if selection.seeds is not None and selection.seeds > suite.seeds:
        whole = whole.model_copy(update={"seeds": selection.seeds})
    if whole == suite:
        return suite
    update = {"name": suite.origin + CHANGED, "gate": {}, "estimators": whole.estimators}
    if "scenarios" in replaced:  # limits to those that were there have no meaning
        free: dict[str, Any] = {"scenarios": (), "seeds_in": {}}
        update["estimators"] = tuple(e.model_copy(update=free) for e in whole.estimators)
    other = select(whole.model_copy(update=update), Selection(**replaced))
    check_suite(other)
    return other


def joined(suite: Suite, selection: Selection, former: Suite | None) -> Suite:
    """A changed suite as it goes on in its folder: what was there, and what is selected now."""
    if (
        former is not None
        and former.rules.fit_every
        and suite.kind == former.kind
        and "fit_every" not in suite.rules.given
    ):
        rules = suite.rules.given | {"fit_every": former.rules.fit_every}
        plain = [e for e in suite.estimators if e.label not in suite.references]
        fitted = {"rules": Rules.model_validate(rules), "estimators": tuple(plain)}
        suite = suite.model_copy(update=fitted).with_references()
    if former is None or former.name != suite.name or not suite.name.endswith(CHANGED):
        return suite
    part = select(suite, selection)
    update: dict[str, Any] = {"seeds": max(suite.seeds, former.seeds)}
    for axis in ("scenarios", "sensors", "estimators", "sigmas"):
        old, new = getattr(former, axis), getattr(part, axis)
        labels = {getattr(entry, "label", entry) for entry in new}
        kept = [entry for entry in old if getattr(entry, "label", entry) not in labels]
        update[axis] = (*kept, *new)
    return suite.model_copy(update=update)


def _with_sigmas(suite: Suite, wanted: tuple[float, ...]) -> Suite:
    levels = suite.levels
    if all(sigma in levels for sigma in wanted):
        return suite
    for sigma in wanted:
        if not (math.isfinite(sigma) and 0 <= sigma <= _LARGEST_SIGMA):
            has = ", ".join(map(str, levels))
            raise UserError(
                f"suite {suite.name!r} has no sigma {shown(sigma)}; it has: {has}, and others can "
                f"be numbers of 0 to {_LARGEST_SIGMA:g}"
            )
    plain = tuple(entry.model_copy(update={"sigmas": ()}) for entry in suite.scenarios)
    return suite.model_copy(update={"sigmas": tuple(wanted), "scenarios": plain})


def _check_names(suite: Suite, kind: plugins.Kind, new: list[str], known: list[str]) -> None:
    others = plugins.names(kind)
    for name in new:
        if name not in others:
            hint = nearest(name, dict.fromkeys([*known, *others]))
            raise UserError(
                f"suite {suite.name!r} has no {kind.name} {shown(name)}; it has: "
                f"{', '.join(known)}; known are also: "
                f"{', '.join(one for one in others if one not in known)}{hint}"
            )

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
from olne_bench.bench.plan.check import check_suite
from olne_bench.bench.plan.kinds import Rules
from olne_bench.bench.plan.learn import Describe, with_named
from olne_bench.bench.plan.suite import CHANGED, Suite
from olne_bench.bench.plan.values import Label, Seeds, Sigma, Strict, shown
from olne_bench.errors import UserError

_LARGEST_SIGMA = 1e6
_KINDS = {
    "scenarios": plugins.SCENARIO,
    "sensors": plugins.SENSOR,
    "estimators": plugins.ESTIMATOR,
}


class Selection(Strict):
    """Which part of a suite to use; an empty field selects everything.

    Attributes:
        scenarios: labels.
        sensors: labels.
        sigmas: noise levels.
        estimators: labels.
        seeds: number of noise draws to use, from the first on.
    """

    scenarios: tuple[Label, ...] = ()
    sensors: tuple[Label, ...] = ()
    sigmas: tuple[Sigma, ...] = ()
    estimators: tuple[Label, ...] = ()
    seeds: Seeds | None = None

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
    """A part of a suite; an empty selection keeps everything.

    What estimators are compared with is in each part, unless the selection names some of it.

    Raises:
        UserError: on a value that the suite does not have; the message names what it has. If no
            scenario has any of the noise levels.
    """
    scenarios = [entry.label for entry in suite.scenarios]
    sensors = [entry.label for entry in suite.sensors]
    estimators = [entry.label for entry in suite.estimators]
    levels = sorted({*suite.sigmas, *(s for entry in suite.scenarios for s in entry.sigmas)})
    _require(suite, "scenario", selection.scenarios, scenarios)
    _require(suite, "sensor", selection.sensors, sensors)
    _require(suite, "sigma", selection.sigmas, levels)
    _require(suite, "estimator", selection.estimators, estimators)
    if selection.seeds is not None and selection.seeds > suite.seeds:
        raise UserError(f"--seeds {selection.seeds}: suite {suite.name!r} has {suite.seeds}")
    sigmas = set(selection.sigmas or levels)
    kept = []
    for entry in suite.scenarios:
        own = tuple(s for s in suite.sigmas_of(entry) if s in sigmas)
        if own and entry.label in (selection.scenarios or scenarios):
            kept.append(entry.model_copy(update={"sigmas": own}) if entry.sigmas else entry)
    if not kept:
        raise UserError(f"suite {suite.name!r} has no scenario with such noise levels: {selection}")
    named = {*(selection.estimators or estimators)}
    if not named & {*suite.references}:
        named |= {*suite.references}
    return suite.model_copy(
        update={
            "scenarios": tuple(kept),
            "sensors": tuple(s for s in suite.sensors if s.label in (selection.sensors or sensors)),
            "sigmas": tuple(s for s in suite.sigmas if s in sigmas),
            "estimators": tuple(e for e in suite.estimators if e.label in named),
        }
    )


def _require(
    suite: Suite, what: str, wanted: Iterable[object], available: Iterable[object]
) -> None:
    known = set(available)
    for value in wanted:
        if value not in known:
            choice = ", ".join(str(item) for item in available)
            raise UserError(f"suite {suite.name!r} has no {what} {shown(value)}; it has: {choice}")


def changed(suite: Suite, selection: Selection, describe: Describe) -> Suite:
    """The suite in which a selection can be made.

    Scenarios, sensors, estimators and noise levels of the selection may be new: then they replace
    those of the suite. More seeds than it has replace theirs.

    Args:
        suite: the suite.
        selection: part of it, or more than it has.
        describe: describes plugins that are new.

    Returns:
        The suite itself if it has all of the selection.

    Raises:
        UserError: on a name that is unknown, or a noise level out of range.
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
    more = selection.seeds is not None and selection.seeds > suite.seeds
    if more:
        whole = whole.model_copy(update={"seeds": selection.seeds})
    if whole == suite:
        return suite
    update = {
        "name": suite.origin + CHANGED,
        "gate": {},
        "estimators": _everywhere(whole, replaced),
    }
    other = select(whole.model_copy(update=update), Selection(**replaced))
    check_suite(other)
    return other


def joined(suite: Suite, selection: Selection, former: Suite | None) -> Suite:
    """A changed suite as it goes on in its folder: what was there, and what is selected now.

    Args:
        suite: the changed suite of this run; any other is left as it is.
        selection: what this run is of.
        former: the suite of the run before; None if this is the first.
    """
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


def _everywhere(suite: Suite, replaced: dict[str, Any]) -> tuple[Any, ...]:
    """Estimators; limits to scenarios that are replaced have no meaning."""
    if "scenarios" not in replaced:
        return suite.estimators
    free: dict[str, Any] = {"scenarios": (), "seeds_in": {}}
    return tuple(entry.model_copy(update=free) for entry in suite.estimators)


def _with_sigmas(suite: Suite, wanted: tuple[float, ...]) -> Suite:
    levels = sorted({*suite.sigmas, *(s for entry in suite.scenarios for s in entry.sigmas)})
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
            hint = plugins.nearest(name, dict.fromkeys([*known, *others]))
            raise UserError(
                f"suite {suite.name!r} has no {kind.name} {shown(name)}; it has: "
                f"{', '.join(known)}; known are also: "
                f"{', '.join(one for one in others if one not in known)}{hint}"
            )

"""Parts of suites."""

import shlex
from collections.abc import Iterable

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.values import Label, Seeds, Sigma, Strict, shown
from olne_bench.errors import UserError


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

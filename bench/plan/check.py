"""Check that the parts of a suite fit each other, once its plugins are known."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence

from olne_bench.bench.plan.entries import FIXED
from olne_bench.bench.plan.outcome import OUTCOME_COLUMNS
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import LABEL_COLUMNS, number_of_trials
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.errors import UserError

#: More trials would not be finished, nor fit into any report.
MOST_TRIALS = 10**8
_COLUMN = re.compile("[a-z][a-z0-9_]{0,59}")
_TAKEN = {*LABEL_COLUMNS, *OUTCOME_COLUMNS, *VERSION_COLUMNS, *FIXED, "run", "checksum", "rowid"}


def check_suite(suite: Suite) -> None:
    """Refuse a suite whose parts do not fit each other.

    Raises:
        UserError: with a message that names the parts.
    """
    _distinct("sigma", suite.sigmas)
    for scenario in suite.scenarios:
        _distinct(f"scenario {scenario.name!r}: sigma", scenario.sigmas)
    _distinct("scenario", [entry.label for entry in suite.scenarios])
    _distinct("sensor", [entry.label for entry in suite.sensors])
    _distinct("estimator label", [entry.label for entry in suite.estimators])
    _check_columns(suite)
    labels = [scenario.label for scenario in suite.scenarios]
    for estimator in suite.estimators:
        complaint = f"estimator {estimator.label!r} is limited to an unknown scenario"
        _named(complaint, [*estimator.scenarios, *estimator.seeds_in], labels)
    _check_seeds(suite)
    number = number_of_trials(suite)
    if number > MOST_TRIALS:
        raise UserError(f"it has {number} trials, at most {MOST_TRIALS} can be run")


def check_gate(suite: Suite) -> None:
    """Refuse limits on anything that a suite, with its added plugins, does not run.

    Raises:
        UserError: with a message that names the table and what the suite has.
    """
    labels = [entry.label for entry in suite.estimators]
    scenarios = [entry.label for entry in suite.scenarios]
    sensors = [entry.label for entry in suite.sensors]
    for label, limits in suite.gate.items():
        place = f"suite {suite.name!r}: [gate.{label}]"
        reference = (limits.time_reference,) if limits.time_reference else ()
        _named(f"{place} is for an unknown estimator", (label,), labels)
        _named(f"{place}: unknown time_reference", reference, labels)
        _named(f"{place}: unknown scenario", limits.scenarios, scenarios)
        _named(f"{place}: unknown sensor", limits.sensors, sensors)
        gated = [e.column for e in suite.metrics if e.declaration.get("gated")]
        _named(f"{place}: unknown limit", limits.metrics, [*gated, *FIXED])


def _check_seeds(suite: Suite) -> None:
    numbers = [(f"scenario {entry.label!r}", entry.seeds) for entry in suite.scenarios]
    for entry in suite.estimators:
        own = (entry.seeds, *entry.seeds_in.values())
        numbers += [(f"estimator {entry.label!r}", number) for number in own]
    for what, number in numbers:
        if number is not None and number > suite.seeds:
            raise UserError(f"{what} has seeds = {number}, the suite has only {suite.seeds}")


def _check_columns(suite: Suite) -> None:
    columns = [entry.column for entry in suite.metrics]
    _distinct("metric", columns)
    for column in columns:
        if not _COLUMN.fullmatch(column) or column in _TAKEN:
            raise UserError(
                f"a metric is called {column!r}: its name becomes a column, so it must have "
                "lower-case letters, digits and underscores only, and not be the name of another "
                "column"
            )


def _named(complaint: str, names: Iterable[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise UserError(f"{complaint} {name!r}; the suite has: {', '.join(known)}")


def _distinct(what: str, keys: Iterable[str | float]) -> None:
    for key, number in Counter(keys).items():
        if number > 1:
            raise UserError(f"{what} {key!r} is listed twice")

"""Suites from TOML files, whose parts have to fit each other."""

import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from olne_bench.bench.plan.entries import (
    FIXED,
    LEARNT,
    EstimatorEntry,
    GateLimits,
    MetricEntry,
    ScenarioEntry,
    SensorEntry,
)
from olne_bench.bench.plan.kinds import REFERENCES, Rules, StudyKind
from olne_bench.bench.plan.learn import Describe, describe_here, learn
from olne_bench.bench.plan.outcome import OUTCOME_COLUMNS
from olne_bench.bench.plan.suite import CHANGED, Suite
from olne_bench.bench.plan.trial import LABEL_COLUMNS, number_of_trials
from olne_bench.bench.plan.values import cut, shown
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.errors import UserError

SUITE_FOLDER = Path(__file__).parent / "suites"
#: No suite that a person writes is longer.
MOST_BYTES = 200_000

_TABLES: dict[str, type[BaseModel]] = {
    "scenarios": ScenarioEntry,
    "sensors": SensorEntry,
    "estimators": EstimatorEntry,
    "metrics": MetricEntry,
    "gate": GateLimits,
    "rules": Rules,
}


def suite_names() -> list[str]:
    """Names of the suites that come with the package."""
    return sorted(path.stem for path in SUITE_FOLDER.glob("*.toml"))


def suite_text(reference: str) -> str:
    """The text of a suite's file."""
    path = _file(reference)
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise UserError(f"suite {path} cannot be read: {error.strerror or error}") from error
    if len(data) > MOST_BYTES:
        raise UserError(f"suite {path} is larger than {MOST_BYTES} bytes: that is not a suite")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise UserError(f"suite {path}: not valid TOML: {error}") from error


def load_suite(
    reference: str,
    plugins: tuple[str, ...] = (),
    describe: Describe = describe_here,
    kind: StudyKind | None = None,
    rules: Mapping[str, Any] | None = None,
) -> Suite:
    """Read a suite by its name or the path of its TOML file (UserError if it is refused).

    ``plugins`` are added to its own; ``kind`` and ``rules`` replace its own.
    """
    text = suite_text(reference)
    place = f"suite {_file(reference)}"
    try:
        data = tomllib.loads(text)
        _refuse_learnt(data)
        data = _ruled(data, kind, rules or {})
        suite = learn(Suite.model_validate(data), plugins, describe).with_references()
        check_suite(suite)
    except ValidationError as error:
        raise UserError(f"{place}: {_first_problem(error)}") from error
    except UserError as error:
        raise UserError(f"{place}: {error}") from error
    except (ValueError, RecursionError) as error:  # numbers of any length, tables of any depth
        raise UserError(f"{place}: not valid TOML: {cut(str(error))}") from error
    return suite


def _ruled(
    data: dict[str, Any], kind: StudyKind | None, rules: Mapping[str, Any]
) -> dict[str, Any]:
    """The contents of a suite's file as a study of another kind, or by other rules.

    It has another name then, unless all rows of the suite are the same in it: fits are rows of
    their own.
    """
    own, former = data.get("kind", "trials"), data.get("rules", {})
    if not isinstance(former, dict) or "name" not in data:
        return data  # refused later
    other = {"kind": kind or own, "rules": (former if kind in (None, own) else {}) | dict(rules)}
    if other["kind"] == own and not {k for k in rules if rules[k] != former.get(k)} - {"fit_every"}:
        return data | ({"rules": other["rules"]} if rules else {})
    salt = data.get("salt") or data["name"]
    kept = {key: value for key, value in data.items() if key != "gate"}
    return kept | other | {"name": f"{data['name']}{CHANGED}", "salt": salt}


def _file(reference: str) -> Path:
    path = Path(reference) if reference.endswith(".toml") else SUITE_FOLDER / f"{reference}.toml"
    try:
        known = path.is_file()
    except (ValueError, OSError):  # a zero byte, or too long for a name
        known = False
    if known:
        return path
    raise UserError(
        f"unknown suite {shown(reference)}; known are: {', '.join(suite_names())}, "
        "or the path of a .toml file"
    )


def _refuse_learnt(data: dict[str, Any]) -> None:
    for table, model in _TABLES.items():
        entries = data.get(table)
        for k, entry in enumerate(entries if isinstance(entries, list) else ()):
            for key in LEARNT.get(model, ()):
                if isinstance(entry, dict) and key in entry:
                    raise UserError(_unknown_key(f"{table}.{k}.{key}", model))


def _first_problem(error: ValidationError) -> str:
    """One line for the first problem of a validation error."""
    problem = error.errors()[0]
    place = cut(".".join(str(part) for part in problem["loc"]))
    if problem["type"] == "extra_forbidden":
        return _unknown_key(place, _TABLES.get(str(problem["loc"][0]), Suite))
    if problem["type"] == "missing":
        return f"key {place!r} is missing"
    cause = problem.get("ctx", {}).get("error")
    if cause is not None:
        return f"{place}: {cause}" if place else str(cause)
    return f"{place}: {problem['msg']}, got {shown(problem['input'])}"


def _unknown_key(place: str, model: type[BaseModel]) -> str:
    learnt = LEARNT.get(model, ())
    known = [name for name in model.model_fields if name not in learnt]
    return f"unknown key {place!r}; known are: {', '.join(known)}"


#: More trials would not be finished, nor fit into any report.
MOST_TRIALS = 10**8
_COLUMN = re.compile("[a-z][a-z0-9_]{0,59}")
_TAKEN = {*LABEL_COLUMNS, *OUTCOME_COLUMNS, *VERSION_COLUMNS, *FIXED, "run", "checksum", "rowid"}


def check_suite(suite: Suite) -> None:
    """Refuse a suite whose parts do not fit each other (UserError)."""
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
    planners = [*(entry.label for entry in suite.estimators), *REFERENCES[suite.kind]]
    for pair in suite.rules.contrasts:
        _named("rule contrasts names an unknown planner", pair, planners)
    _check_seeds(suite)
    number = number_of_trials(suite)
    if number > MOST_TRIALS:
        raise UserError(f"it has {number} trials, at most {MOST_TRIALS} can be run")


def check_gate(suite: Suite) -> None:
    """Refuse limits on what a suite, with its added plugins, does not run (UserError)."""
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

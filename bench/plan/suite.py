"""Suites: what to run, and the salt that seeds its noise and draws.

Anyone who knows the salt can draw the noise again and subtract it. The salt of a published suite is
its name, so that its rows can be repeated. A fresh salt is unknown before its run.
"""

import hashlib
import secrets
from functools import lru_cache
from typing import Any, TypeVar

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from olne_bench.bench.plan.entries import (
    MOST_SIGMAS,
    EstimatorEntry,
    GateLimits,
    MetricEntry,
    ScenarioEntry,
    SensorEntry,
    tables,
)
from olne_bench.bench.plan.kinds import (
    REFERENCES,
    RULES,
    STOCK_FITTED,
    FigureKind,
    Rules,
    StudyKind,
)
from olne_bench.bench.plan.values import (
    LABEL_LENGTH,
    Iterations,
    Label,
    Name,
    Seconds,
    Seeds,
    Sigma,
    Strict,
    Text,
    Trajectories,
    cut,
    shown,
)
from olne_bench.errors import UserError
from olne_bench.games.solve.ipopt import PUBLISHED_ITERATIONS

MOST_ENTRIES = 1000
#: Ends the name of a suite that the options of a run have changed, as it is another study.
CHANGED = " (changed)"
#: An estimator that is always there, in the place of one in the entry of a reference.
_NONE = "uniform"

_Labelled = TypeVar("_Labelled", ScenarioEntry, SensorEntry, EstimatorEntry)


class Suite(Strict):
    """A study: every combination of scenario, sensor, noise level, seed and estimator."""

    name: Name
    description: Text = ""  # one line for ``olne-bench list``
    kind: StudyKind = "trials"  # what one unit of the study is
    rules: Rules = Rules()
    salt: Label = ""  # seeds the streams of noise and draws; default: the name
    scenarios: tuple[ScenarioEntry, ...] = Field(min_length=1, max_length=MOST_ENTRIES)
    sensors: tuple[SensorEntry, ...] = Field(min_length=1, max_length=MOST_ENTRIES)
    # on positions [m]; times ``noise_scale`` on other components of the state
    sigmas: tuple[Sigma, ...] = Field(min_length=1, max_length=MOST_SIGMAS)
    seeds: Seeds  # draws per level; at sigma 0 a fixed scenario has one, which counts as that many
    time_limit: Seconds = 60.0  # of each stage of a trial [s]: set-up, estimate, scoring
    # of IPOPT, to the root at the estimated weights; 0: the path of roots is followed instead
    root_iterations: Iterations = PUBLISHED_ITERATIONS
    trajectories: Trajectories = 1  # unless a scenario sets its own
    estimators: tuple[EstimatorEntry, ...] = Field(min_length=1, max_length=MOST_ENTRIES)
    # a file need not list the built-in ones
    metrics: tuple[MetricEntry, ...] = Field(default=(), max_length=MOST_ENTRIES)
    left_out: tuple[Name, ...] = ()  # built-in metrics that are not measured
    gate: dict[Label, GateLimits] = Field(default_factory=dict)  # limits by estimator label

    figures: tuple[FigureKind, ...] = ()  # what reports draw; none named: all

    @model_validator(mode="before")
    @classmethod
    def _usual_salt_and_trajectories(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        if not data.get("salt", "") and "name" in data:
            data = data | {"salt": data["name"]}
        if isinstance(data.get("scenarios"), list) and "trajectories" in data:
            common = {"trajectories": data["trajectories"]}
            named = tables(data["scenarios"])
            data = data | {"scenarios": [common | s if isinstance(s, dict) else s for s in named]}
        return data

    @field_validator("scenarios", "sensors", "estimators", "metrics", mode="before")
    @classmethod
    def _names_are_entries(cls, value: Any) -> Any:
        return tables(value)

    @model_validator(mode="after")
    def _rules_are_those_of_its_kind(self) -> "Suite":
        for name in self.rules.given:
            if name not in RULES[self.kind]:
                known = ", ".join(RULES[self.kind]) or "none"
                raise ValueError(
                    f"a study of {self.kind} has no rule {name!r}; its rules are: {known}"
                )
        if self.kind != "drives":
            for entry in self.estimators:
                if entry.planning:
                    raise ValueError(
                        f"estimator {entry.name!r} has planning = {entry.planning!r}, in a study "
                        f"of {self.kind}: only the ego of a drive plans"
                    )
        if self.gate and self.kind != "trials":
            raise ValueError(f"a study of {self.kind} has no [gate] table: limits are of trials")
        return self

    @model_serializer(mode="wrap")
    def _what_is_set(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Without what is the usual one of kind, rules, figures and metrics left out."""
        data: dict[str, Any] = handler(self) | {"rules": self.rules.given}
        usual = {"kind": "trials", "rules": {}, "figures": (), "left_out": ()}
        return {key: value for key, value in data.items() if usual.get(key) != value}

    @property
    def origin(self) -> str:
        """Name of the suite that this one was changed from; its own if it was not changed."""
        return self.name.removesuffix(CHANGED)

    def scenario(self, label: str) -> ScenarioEntry:
        """The scenario that has this label."""
        return self._find("scenario", label, self.scenarios)

    def sensor(self, label: str) -> SensorEntry:
        """The sensor that has this label."""
        return self._find("sensor", label, self.sensors)

    def _find(self, what: str, label: str, entries: tuple[_Labelled, ...]) -> _Labelled:
        for entry in entries:
            if entry.label == label:
                return entry
        choice = ", ".join(entry.label for entry in entries)
        raise UserError(f"suite {self.name!r} has no {what} {label!r}; it has: {choice}")

    @property
    def references(self) -> tuple[str, ...]:
        """Labels of what estimators are compared with."""
        return tuple(e.label for e in self.estimators if e.label in REFERENCES[self.kind])

    def with_references(self) -> "Suite":
        """A suite that was read, with an entry for each reference of its kind, which come first."""
        if self.references:
            raise UserError(
                f"an estimator is called {self.references[0]!r}; in a study of {self.kind}, that "
                "is what estimators are compared with: give it another label"
            )
        names = [n for n in REFERENCES[self.kind] if n != STOCK_FITTED or self.rules.fit_every]
        entries = (EstimatorEntry(name=_NONE, label=name) for name in names)
        return self.model_copy(update={"estimators": (*entries, *self.estimators)})

    def pairs(self) -> list[tuple[ScenarioEntry, EstimatorEntry]]:
        """Scenarios and the estimators that are run on them."""
        return [
            (scenario, estimator)
            for scenario in self.scenarios
            for estimator in self.estimators
            if not estimator.scenarios or scenario.label in estimator.scenarios
        ]

    @property
    def levels(self) -> list[float]:
        """All noise levels, those of single scenarios too."""
        return sorted({*self.sigmas, *(s for entry in self.scenarios for s in entry.sigmas)})

    def sigmas_of(self, scenario: ScenarioEntry) -> tuple[float, ...]:
        """Noise levels of a scenario."""
        return scenario.sigmas or self.sigmas

    def seeds_of(self, scenario: ScenarioEntry, estimator: EstimatorEntry) -> int:
        """Noise draws per level that an estimator is run on in a scenario."""
        own = estimator.seeds_in.get(scenario.label, estimator.seeds)
        limits = (self.seeds, scenario.seeds, own)
        return min(limit for limit in limits if limit is not None)


def read_suite_json(text: str) -> Suite:
    """A suite that a run has stored; its plugins need not exist any more."""
    try:
        return Suite.model_validate_json(text)
    except ValidationError as error:
        problem = error.errors()[0]
        place = ".".join(str(part) for part in problem["loc"])
        raise UserError(
            "the suite that the store holds cannot be read: it is damaged, or of another version "
            f"of olne-bench ({cut(place)}: {cut(problem['msg'])}, got {shown(problem['input'])})"
        ) from error


#: Asks for a secret salt.
FRESH = "fresh"


@lru_cache(maxsize=64)
def salt_id(salt: str) -> str:
    """A hash of a salt for rows: it distinguishes salts and does not reveal them."""
    return hashlib.sha256(salt.encode()).hexdigest()[:8]


def check_salt(wanted: str | None) -> None:
    """Refuse an empty text, a long one, and one that is not printable on one line (UserError)."""
    if wanted is None or (wanted.strip() and wanted.isprintable() and len(wanted) <= LABEL_LENGTH):
        return
    raise UserError(
        f"--salt {shown(wanted)}: a salt is {FRESH!r}, or a text of 1 to {LABEL_LENGTH} characters "
        "without line breaks"
    )


def salted(suite: Suite, wanted: str | None, former: Suite | None) -> Suite:
    """The suite with the salt of its run: ``wanted``, else that of the former run, or its own."""
    if former is None:
        salt = secrets.token_hex(16) if wanted == FRESH else wanted or suite.salt
        return suite.model_copy(update={"salt": salt})
    # A repeated command with --salt fresh continues with the salt that was drawn the first time.
    drawn = wanted == FRESH and former.salt != suite.salt
    if wanted not in (None, former.salt) and not drawn:
        raise UserError(
            f"--salt {shown(wanted)} is not that of the run to continue, which has "
            f"{salt_id(former.salt)}; leave --salt out, or use another --out"
        )
    return suite.model_copy(update={"salt": former.salt})

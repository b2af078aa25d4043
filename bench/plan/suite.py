"""Suites: what to run."""

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
from olne_bench.bench.plan.kinds import REFERENCES, RULES, STOCK_FITTED, Rules, StudyKind
from olne_bench.bench.plan.values import (
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
    """A study: every combination of scenario, sensor, noise level, seed and estimator.

    Attributes:
        name: short name.
        description: one line for ``olne-bench list``.
        kind: what one unit of the study is.
        rules: rules of this kind.
        salt: seeds the streams of noise and draws. Default: the name.
        scenarios: names, or tables with options.
        sensors: names, or tables with parameters or stacks.
        sigmas: noise levels: standard deviation on positions [m], and times the scenario's
            ``noise_scale`` on the other components of the state.
        seeds: noise draws per level; at sigma 0 a fixed scenario has only one, which counts as
            that many.
        time_limit: wall-clock seconds after which a stage of a trial (set-up, estimate, scoring) is
            killed.
        root_iterations: iterations that IPOPT may take to find the root nearest the truth at the
            estimated weights. Default: those of the published study. 0: the path of roots from
            the true weights is followed instead (``games.solve.nearest_root.predict``).
        trajectories: number of trajectories of each trial, unless a scenario sets its own.
        estimators: names, or tables with parameters.
        metrics: names, or tables with parameters; a file need not list the built-in ones.
        gate: limits by estimator label, which ``olne-bench gate`` checks.
    """

    name: Name
    description: Text = ""
    kind: StudyKind = "trials"
    rules: Rules = Rules()
    salt: Label = ""
    scenarios: tuple[ScenarioEntry, ...] = Field(min_length=1, max_length=MOST_ENTRIES)
    sensors: tuple[SensorEntry, ...] = Field(min_length=1, max_length=MOST_ENTRIES)
    sigmas: tuple[Sigma, ...] = Field(min_length=1, max_length=MOST_SIGMAS)
    seeds: Seeds
    time_limit: Seconds = 60.0
    root_iterations: Iterations = PUBLISHED_ITERATIONS
    trajectories: Trajectories = 1
    estimators: tuple[EstimatorEntry, ...] = Field(min_length=1, max_length=MOST_ENTRIES)
    metrics: tuple[MetricEntry, ...] = Field(default=(), max_length=MOST_ENTRIES)
    gate: dict[Label, GateLimits] = Field(default_factory=dict)

    @model_validator(mode="before")
    @classmethod
    def _salted_by_its_name(cls, data: Any) -> Any:
        if isinstance(data, dict) and not data.get("salt", "") and "name" in data:
            return data | {"salt": data["name"]}
        return data

    @model_validator(mode="before")
    @classmethod
    def _trajectories_are_those_of_scenarios(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and isinstance(data.get("scenarios"), list)):
            return data
        common = {"trajectories": data["trajectories"]} if "trajectories" in data else {}
        named = tables(data["scenarios"])
        scenarios = [common | s if isinstance(s, dict) else s for s in named]
        return data | {"scenarios": scenarios}

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
        if self.gate and self.kind != "trials":
            raise ValueError(f"a study of {self.kind} has no [gate] table: limits are of trials")
        return self

    @model_serializer(mode="wrap")
    def _what_is_set(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Without a kind and rules where they are the usual ones."""
        data: dict[str, Any] = handler(self) | {"rules": self.rules.given}
        usual = {"kind": "trials", "rules": {}}
        return {key: value for key, value in data.items() if usual.get(key) != value}

    @property
    def origin(self) -> str:
        """Name of the suite that this one was changed from; its own if it was not changed."""
        return self.name.removesuffix(CHANGED)

    def scenario(self, label: str) -> ScenarioEntry:
        """The scenario that has this label.

        Raises:
            UserError: if there is none.
        """
        return self._find("scenario", label, self.scenarios)

    def sensor(self, label: str) -> SensorEntry:
        """The sensor that has this label.

        Raises:
            UserError: if there is none.
        """
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
        """A suite that was read, with an entry for each reference of its kind, which come first.

        Raises:
            UserError: if an estimator is called like one.
        """
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

    def sigmas_of(self, scenario: ScenarioEntry) -> tuple[float, ...]:
        """Noise levels of a scenario."""
        return scenario.sigmas or self.sigmas

    def seeds_of(self, scenario: ScenarioEntry, estimator: EstimatorEntry) -> int:
        """Noise draws per level that an estimator is run on in a scenario."""
        own = estimator.seeds_in.get(scenario.label, estimator.seeds)
        limits = (self.seeds, scenario.seeds, own)
        return min(limit for limit in limits if limit is not None)


def read_suite_json(text: str) -> Suite:
    """A suite that a run has stored; its plugins need not exist any more.

    Raises:
        UserError: if the text is not a suite.
    """
    try:
        return Suite.model_validate_json(text)
    except ValidationError as error:
        problem = error.errors()[0]
        place = ".".join(str(part) for part in problem["loc"])
        raise UserError(
            "the suite that the store holds cannot be read: it is damaged, or of another version "
            f"of olne-bench ({cut(place)}: {cut(problem['msg'])}, got {shown(problem['input'])})"
        ) from error

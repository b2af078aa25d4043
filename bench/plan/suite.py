"""Suites: what to run, as TOML checked against a schema."""

import ast
import json
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from olne_bench.envs.scenarios import check_options
from olne_bench.errors import UserError
from olne_bench.estimators.registry import (
    EstimatorError,
    absolute_reference,
    estimator_label,
    load_estimator,
)
from olne_bench.games.nearest_root import PUBLISHED_ITERATIONS
from olne_bench.games.observation import VIEWS

SUITE_FOLDER = Path(__file__).parent / "suites"

# Strict, as TOML has types: true is no number, and 3.5 no count.
Sigma = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Bound = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Count = Annotated[int, Field(gt=0, strict=True)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ScenarioEntry(_Strict):
    """A scenario with its options, such as ``num_players`` of ``random``.

    Attributes:
        name: of the scenario.
        options: of its own.
        trajectories: how many times the players are seen, each time from another start
            (``bench.judge.nearby_starts``); the suite's where absent.
        sigmas: noise levels; the suite's where empty.
        seeds: the first so many noise draws only; all where absent.
    """

    name: str
    options: dict[str, Any] = {}
    trajectories: Count = 1
    sigmas: tuple[Sigma, ...] = ()
    seeds: Count | None = None

    @property
    def label(self) -> str:
        """Name in tables: options follow in parentheses."""
        named = dict(self.options)
        if self.trajectories > 1:
            named["trajectories"] = self.trajectories
        options = ",".join(f"{key}={value}" for key, value in sorted(named.items()))
        return f"{self.name}({options})" if options else self.name

    @classmethod
    def from_label(cls, label: str) -> "ScenarioEntry":
        """The entry that has this label; options that do not look like numbers are text."""
        name, _, options = label.removesuffix(")").partition("(")
        pairs = [option.partition("=") for option in options.split(",") if option]
        values = {key: _value(text) for key, _, text in pairs}
        return cls(name=name, trajectories=values.pop("trajectories", 1), options=values)


def _value(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (SyntaxError, ValueError):
        return text


class EstimatorEntry(_Strict):
    """An estimator with its parameters; ``label`` tells apart two settings of the same one.

    Attributes:
        name: of the estimator, or its file.
        parameters: its own.
        label: name in tables.
        scenarios: labels of the scenarios that it is run on; all where absent.
        seeds: the first so many noise draws only; all where absent.
    """

    name: str
    parameters: dict[str, Any] = {}
    label: str = ""
    scenarios: tuple[str, ...] = ()
    seeds: Count | None = None


class GateLimits(_Strict):
    """What an estimator must keep to be accepted, in each scenario and view by itself.

    Attributes:
        scenarios: labels of those that count; all where empty.
        sensors: names of those that count; all where empty.
        metrics: largest medians of metrics, by column.
        identifiable_cosine_error: largest median.
        limit_ratio: largest mean cosine error over its statistical limit.
        failures: most trials without a prediction.
        published_failures: most failures by the published definition.
        time_ratio: largest median time over that of the estimator ``time_reference``.
        time_reference: label of an estimator of the same run.
    """

    scenarios: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    metrics: dict[str, Bound] = {}
    identifiable_cosine_error: Bound | None = None
    limit_ratio: Bound | None = None
    failures: int | None = Field(default=None, ge=0, strict=True)
    published_failures: int | None = Field(default=None, ge=0, strict=True)
    time_ratio: Bound | None = None
    time_reference: str = ""

    @model_validator(mode="before")
    @classmethod
    def _others_are_of_metrics(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "metrics" in data:
            return data
        own = {key: value for key, value in data.items() if key in cls.model_fields}
        return own | {"metrics": {key: data[key] for key in data if key not in own}}

    @model_validator(mode="after")
    def _times_have_a_reference(self) -> "GateLimits":
        if (self.time_ratio is None) != (not self.time_reference):
            raise ValueError("time_ratio and time_reference belong together")
        if not self.bounds:
            raise ValueError(f"no limit is set; there are those of metrics, {', '.join(_LIMITS)}")
        return self

    @property
    def bounds(self) -> dict[str, float]:
        """The limits that are set, by name."""
        values = self.metrics | {name: getattr(self, name) for name in _LIMITS}
        return {name: value for name, value in values.items() if value is not None}


_LIMITS = (
    "identifiable_cosine_error",
    "limit_ratio",
    "failures",
    "published_failures",
    "time_ratio",
)


class Suite(_Strict):
    """A study: every combination of scenario, view, noise level, seed and estimator.

    Attributes:
        name: short name.
        description: one line for ``olne-bench list``.
        scenarios: names or tables with options.
        views: names of observation models.
        sigmas: noise levels: standard deviation on positions [m], and times the scenario's
            ``noise_scale`` on the other components of the state.
        seeds: noise draws per level; at sigma 0 a fixed scenario has only one, which counts as
            that many.
        time_limit: wall-clock seconds after which a stage of a trial (set-up, estimate, scoring) is
            killed.
        root_iterations: iterations that IPOPT may take to find the root nearest the truth at the
            estimated weights; the published study's, where absent.
        trajectories: how many trajectories each trial shows, where a scenario does not say.
        estimators: names or tables with parameters.
        gate: limits by estimator label, which ``olne-bench gate`` checks.
    """

    name: str
    description: str = ""
    scenarios: tuple[ScenarioEntry, ...] = Field(min_length=1)
    views: tuple[str, ...] = Field(min_length=1)
    sigmas: tuple[Sigma, ...] = Field(min_length=1)
    seeds: Count
    time_limit: float = Field(default=60.0, gt=0, allow_inf_nan=False, strict=True)
    root_iterations: Count = PUBLISHED_ITERATIONS
    trajectories: Count = 1
    estimators: tuple[EstimatorEntry, ...] = Field(min_length=1)
    gate: dict[str, GateLimits] = {}

    @model_validator(mode="before")
    @classmethod
    def _trajectories_are_those_of_scenarios(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and isinstance(data.get("scenarios"), list)):
            return data
        common = {"trajectories": data["trajectories"]} if "trajectories" in data else {}
        named = [{"name": s} if isinstance(s, str) else s for s in data["scenarios"]]
        scenarios = [common | s if isinstance(s, dict) else s for s in named]
        return data | {"scenarios": scenarios}

    @field_validator("name")
    @classmethod
    def _has_a_name(cls, value: str) -> str:
        if not value.strip():
            raise ValueError(f"a suite needs a name that is not empty, got {value!r}")
        return value

    @field_validator("scenarios", "estimators", mode="before")
    @classmethod
    def _names_are_entries(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [{"name": item} if isinstance(item, str) else item for item in value]
        return value

    @field_validator("scenarios")
    @classmethod
    def _scenarios_exist(cls, value: tuple[ScenarioEntry, ...]) -> tuple[ScenarioEntry, ...]:
        for entry in value:
            _distinct(entry.sigmas, f"scenario {entry.name!r}: sigma", entry.sigmas)
            try:
                check_options(entry.name, **entry.options)
            except TypeError as error:
                raise ValueError(f"scenario {entry.name!r} refuses its options: {error}") from error
        return _distinct(value, "scenario", [entry.label for entry in value])

    @field_validator("views")
    @classmethod
    def _views_exist(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for name in value:
            if name not in VIEWS:
                raise ValueError(f"unknown view {name!r}; known are: {', '.join(VIEWS)}")
        return _distinct(value, "view", value)

    @field_validator("sigmas")
    @classmethod
    def _sigmas_differ(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        return _distinct(value, "sigma", value)

    @field_validator("estimators")
    @classmethod
    def _estimators_exist(cls, value: tuple[EstimatorEntry, ...]) -> tuple[EstimatorEntry, ...]:
        from olne_bench.bench.run.loading import probe  # it runs trials, which are made of suites

        probe((entry.name, entry.parameters) for entry in value)
        labelled = []
        for entry in value:
            load_estimator(entry.name, entry.parameters)
            label = entry.label or estimator_label(entry.name)
            # Whoever goes on with the run, or works on it elsewhere, may be in another folder.
            name = absolute_reference(entry.name)
            labelled.append(entry.model_copy(update={"label": label, "name": name}))
        return _distinct(tuple(labelled), "estimator label", [entry.label for entry in labelled])

    @model_validator(mode="after")
    def _estimators_have_their_scenarios(self) -> "Suite":
        labels = [scenario.label for scenario in self.scenarios]
        for entry in self.estimators:
            complaint = f"estimator {entry.label!r} is limited to an unknown scenario"
            _named(complaint, entry.scenarios, labels)
        return self

    @model_validator(mode="after")
    def _parts_fit_the_whole(self) -> "Suite":
        entries: list[tuple[str, ScenarioEntry | EstimatorEntry]] = [
            *(("scenario", entry) for entry in self.scenarios),
            *(("estimator", entry) for entry in self.estimators),
        ]
        for what, entry in entries:
            if entry.seeds is not None and entry.seeds > self.seeds:
                raise ValueError(
                    f"{what} {entry.label!r} has seeds = {entry.seeds}, the suite has only "
                    f"{self.seeds}"
                )
        return self

    def pairs(self) -> list[tuple[ScenarioEntry, EstimatorEntry]]:
        """Which estimator is run on which scenario."""
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
        limits = (self.seeds, scenario.seeds, estimator.seeds)
        return min(limit for limit in limits if limit is not None)


def suite_names() -> list[str]:
    """Names of the suites that come with the package."""
    return sorted(path.stem for path in SUITE_FOLDER.glob("*.toml"))


def suite_file(reference: str) -> Path:
    """The file of a suite.

    Raises:
        UserError: on an unknown suite.
    """
    path = Path(reference) if reference.endswith(".toml") else SUITE_FOLDER / f"{reference}.toml"
    if not path.is_file():
        raise UserError(
            f"unknown suite {reference!r}; known are: {', '.join(suite_names())}, "
            "or the path of a .toml file"
        )
    return path


def load_suite(reference: str, plugins: tuple[str, ...] = ()) -> Suite:
    """Read a suite.

    Args:
        reference: a name from ``suite_names()`` or the path of a TOML file.
        plugins: estimator references to add to the suite's own.

    Raises:
        UserError: on an unknown suite, unreadable TOML or a value that the schema refuses.
    """
    path = suite_file(reference)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"suite {path}: not valid TOML: {error}") from error
    if plugins and isinstance(data.get("estimators"), list):
        data["estimators"] += plugins
    try:
        return Suite.model_validate(data)
    except ValidationError as error:
        raise UserError(f"suite {path}: {_first_problem(error)}") from error
    except (EstimatorError, UserError) as error:
        raise UserError(f"suite {path}: {error}") from error


def check_gate(suite: Suite) -> None:
    """Refuse limits on what a suite, with the plugins added to it, does not run.

    Raises:
        UserError: naming the table and what the suite has.
    """
    labels = [entry.label for entry in suite.estimators]
    scenarios = [entry.label for entry in suite.scenarios]
    for label, limits in suite.gate.items():
        place = f"suite {suite.name!r}: [gate.{label}]"
        reference = (limits.time_reference,) if limits.time_reference else ()
        try:
            _named(f"{place} is for an unknown estimator", (label,), labels)
            _named(f"{place}: unknown time_reference", reference, labels)
            _named(f"{place}: unknown scenario", limits.scenarios, scenarios)
            _named(f"{place}: unknown sensor", limits.sensors, suite.views)
        except ValueError as error:
            raise UserError(str(error)) from error


def read_suite_json(text: str) -> Suite:
    """A suite as a run has stored it, whether or not all it names still exists.

    Raises:
        UserError: where it is none.
    """
    try:
        data = json.loads(text)
        return Suite.model_construct(
            **data
            | {
                "scenarios": tuple(ScenarioEntry(**entry) for entry in data["scenarios"]),
                "views": tuple(data["views"]),
                "sigmas": tuple(data["sigmas"]),
                "estimators": tuple(EstimatorEntry(**entry) for entry in data["estimators"]),
                "gate": {
                    label: GateLimits.model_validate(limits)
                    for label, limits in data.get("gate", {}).items()
                },
            }
        )
    except (ValueError, TypeError, KeyError) as error:  # pydantic's are ValueErrors
        raise UserError(
            "the suite that the store holds cannot be read: it is damaged, or of another version "
            f"of olne-bench ({' '.join(str(error).split())})"
        ) from error


def select(
    suite: Suite,
    *,
    scenarios: tuple[str, ...] = (),
    views: tuple[str, ...] = (),
    sigmas: tuple[float, ...] = (),
    estimators: tuple[str, ...] = (),
) -> Suite:
    """A part of a suite; an empty selection keeps everything.

    Raises:
        UserError: on a value that the suite does not have; the message names what it has.
    """
    labels = [entry.label for entry in suite.scenarios]
    estimator_labels = [entry.label for entry in suite.estimators]
    levels = sorted({*suite.sigmas, *(s for entry in suite.scenarios for s in entry.sigmas)})
    _require(suite, "scenario", scenarios, labels)
    _require(suite, "view", views, suite.views)
    _require(suite, "sigma", sigmas, levels)
    _require(suite, "estimator", estimators, estimator_labels)
    kept = []
    for entry in suite.scenarios:
        own = tuple(s for s in suite.sigmas_of(entry) if s in (sigmas or levels))
        if own and entry.label in (scenarios or labels):
            kept.append(entry.model_copy(update={"sigmas": own}) if entry.sigmas else entry)
    return suite.model_copy(
        update={
            "scenarios": tuple(kept),
            "views": tuple(v for v in suite.views if v in (views or suite.views)),
            "sigmas": tuple(s for s in suite.sigmas if s in (sigmas or levels)),
            "estimators": tuple(
                e for e in suite.estimators if e.label in (estimators or estimator_labels)
            ),
        }
    )


def _require(suite: Suite, what: str, wanted: Any, available: Any) -> None:
    for value in wanted:
        if value not in available:
            choice = ", ".join(str(item) for item in available)
            raise UserError(f"suite {suite.name!r} has no {what} {value!r}; it has: {choice}")


def _named(complaint: str, names: Iterable[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise ValueError(f"{complaint} {name!r}; the suite has: {', '.join(known)}")


def _distinct(value: Any, what: str, keys: Any) -> Any:
    for key in keys:
        if list(keys).count(key) > 1:
            raise ValueError(f"{what} {key!r} is listed twice")
    return value


def _first_problem(error: ValidationError) -> str:
    """One line for the first problem of a validation error."""
    problem = error.errors()[0]
    place = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        entries: dict[str, type[BaseModel]] = {
            "scenarios": ScenarioEntry,
            "estimators": EstimatorEntry,
            "gate": GateLimits,
        }
        model = entries.get(str(problem["loc"][0]), Suite)
        return f"unknown key {place!r}; known are: {', '.join(model.model_fields)}"
    if problem["type"] == "missing":
        return f"key {place!r} is missing"
    cause = problem.get("ctx", {}).get("error")
    if cause is not None:
        return f"{place}: {cause}" if place else str(cause)
    return f"{place}: {problem['msg']}, got {problem['input']!r}"

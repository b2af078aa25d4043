"""The entries of a suite: scenarios, sensors, estimators, metrics, and limits of its gate.

A suite file holds only a part of them. The rest is learnt from the plugins when the suite is loaded
(``bench.plan.learn``) and stored with it, so a stored suite can be read without its plugins.
"""

from typing import Any

from pydantic import Field, field_validator, model_validator

from olne_bench.bench.plan.kinds import Planning
from olne_bench.bench.plan.values import (
    Bound,
    Label,
    Parameters,
    Reference,
    Seeds,
    Sigma,
    Strict,
    Trajectories,
)

#: Largest number of noise levels of a suite or scenario.
MOST_SIGMAS = 10_000
#: Limits that do not depend on the metrics of a suite.
FIXED = ("identifiable_cosine_error", "limit_ratio", "failures", "published_failures", "time_ratio")


class PluginEntry(Strict):
    """A plugin with its parameters."""

    name: Reference
    parameters: Parameters = Field(default_factory=dict)


class ScenarioEntry(Strict):
    """A scenario with its options, such as ``num_players`` of ``random``."""

    name: Reference
    options: Parameters = Field(default_factory=dict)
    label: Label = ""  # default: the scenario's name with its options in parentheses
    trajectories: Trajectories = 1  # each from another start (``bench.judge.nearby_starts``)
    # default: those of the suite
    sigmas: tuple[Sigma, ...] = Field(default=(), max_length=MOST_SIGMAS)
    seeds: Seeds | None = None  # number of draws to use, from the first on; default: all
    family: bool = False  # learnt: whether each seed draws another game


class SensorEntry(Strict):
    """A sensor: a stack of layers, the innermost first.

    In a suite's file it is ``"full"``, or ``{name = "drop", parameters = {p = 0.3}}``, or
    ``{label = "gappy", stack = ["partial", {name = "drop", parameters = {p = 0.3}}]}``.
    """

    label: Label = ""  # default: the names of the layers
    layers: tuple[PluginEntry, ...] = Field(min_length=1, max_length=20)

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "layers" in data:
            return data
        rest = dict(data)
        if "stack" in rest:
            stack = rest.pop("stack")
            if "name" in rest or "parameters" in rest:
                raise ValueError("a sensor has a name, or a stack of sensors, not both")
            return rest | {"layers": tables(stack)}
        if "name" not in rest:
            raise ValueError("a sensor has a name, or a stack of sensors")
        layer = {key: rest.pop(key) for key in ("name", "parameters") if key in rest}
        return rest | {"layers": [layer]}


class EstimatorEntry(Strict):
    """An estimator with its parameters; ``label`` distinguishes two settings of the same one."""

    name: Reference
    parameters: Parameters = Field(default_factory=dict)
    label: Label = ""
    scenarios: tuple[Label, ...] = ()  # labels; default: all
    seeds: Seeds | None = None  # number of draws to use, from the first on; default: all
    # by label of scenario; goes before ``seeds``
    seeds_in: dict[Label, Seeds] = Field(default_factory=dict)
    planning: Planning | None = None  # of the ego of a drive; None: by one equilibrium
    several: bool = False  # learnt: whether it takes several trajectories at once


class MetricEntry(Strict):
    """A metric with its parameters; ``label`` distinguishes two settings of the same one."""

    name: Reference
    parameters: Parameters = Field(default_factory=dict)
    label: Label = ""
    column: Label = ""  # learnt
    # learnt: fields of its ``MetricDeclaration``
    declaration: dict[str, Any] = Field(default_factory=dict)

    @field_validator("declaration")
    @classmethod
    def _no_methods(cls, value: dict[str, Any]) -> dict[str, Any]:
        for key, item in value.items():
            if not isinstance(item, str | int | float | bool | None):
                raise ValueError(f"{key!r} of a metric must be a text or a number, got {item!r}")
        return value


class GateLimits(Strict):
    """Limits for one estimator, in each scenario and sensor separately.

    Any other key in the table of a suite file is the column of a metric and limits its median.
    """

    scenarios: tuple[Label, ...] = ()  # labels; default: all
    sensors: tuple[Label, ...] = ()  # labels; default: all
    identifiable_cosine_error: Bound | None = None  # largest median
    limit_ratio: Bound | None = None  # largest mean cosine error over its statistical limit
    # most trials without a prediction
    failures: int | None = Field(default=None, ge=0, strict=True)
    # most failures by the published definition
    published_failures: int | None = Field(default=None, ge=0, strict=True)
    time_ratio: Bound | None = None  # largest median time over that of ``time_reference``
    time_reference: Label = ""
    metrics: dict[str, Bound] = Field(default_factory=dict)  # largest medians, by column

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
            raise ValueError(f"no limit is set; limits are those of metrics, {', '.join(FIXED)}")
        return self

    @property
    def bounds(self) -> dict[str, float]:
        """The limits that are set, by name."""
        values = self.metrics | {name: getattr(self, name) for name in FIXED}
        return {name: value for name, value in values.items() if value is not None}


#: Keys that plugins give; a suite file must not have them.
LEARNT = {
    ScenarioEntry: ("family",),
    SensorEntry: (),
    EstimatorEntry: ("several",),
    MetricEntry: ("column", "declaration"),
}


def tables(items: Any) -> Any:
    """A list of entries in which each plain name is replaced by a table with that name."""
    if isinstance(items, list | tuple):
        return [{"name": item} if isinstance(item, str) else item for item in items]
    return items

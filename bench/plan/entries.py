"""What a suite lists: scenarios, sensors, estimators and metrics, each with its parameters.

A suite file says little about them. The rest is learnt from the plugins when the suite is loaded
(``bench.plan.learn``) and stored with it, so a stored suite can be read without its plugins.
"""

from typing import Any

from pydantic import Field, field_validator, model_validator

from olne_bench.bench.plan.values import (
    Label,
    Parameters,
    Reference,
    Seeds,
    Sigma,
    Strict,
    Trajectories,
)

#: Noise levels of one suite or scenario.
MOST_SIGMAS = 10_000


class PluginEntry(Strict):
    """A plugin with its parameters.

    Attributes:
        name: of the plugin, or its file.
        parameters: its own.
    """

    name: Reference
    parameters: Parameters = Field(default_factory=dict)


class ScenarioEntry(Strict):
    """A scenario with its options, such as ``num_players`` of ``random``.

    Attributes:
        name: of the scenario, or its file.
        options: of its own.
        label: name in tables; the scenario's with its options in parentheses where absent.
        trajectories: how many times the players are seen, each time from another start
            (``bench.judge.nearby_starts``); the suite's where absent.
        sigmas: noise levels; the suite's where empty.
        seeds: the first so many noise draws only; all where absent.
        family: whether every seed is a game of its own; learnt.
    """

    name: Reference
    options: Parameters = Field(default_factory=dict)
    label: Label = ""
    trajectories: Trajectories = 1
    sigmas: tuple[Sigma, ...] = Field(default=(), max_length=MOST_SIGMAS)
    seeds: Seeds | None = None
    family: bool = False


class SensorEntry(Strict):
    """A sensor: layers through which the players are seen, the innermost first.

    In a suite's file it is ``"full"``, or ``{name = "drop", parameters = {p = 0.3}}``, or
    ``{label = "gappy", stack = ["partial", {name = "drop", parameters = {p = 0.3}}]}``.

    Attributes:
        label: name in tables; those of the layers where absent.
        layers: sensors with their parameters.
    """

    label: Label = ""
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
    """An estimator with its parameters; ``label`` tells apart two settings of the same one.

    Attributes:
        name: of the estimator, or its file.
        parameters: its own.
        label: name in tables; the estimator's own where absent.
        scenarios: labels of the scenarios that it is run on; all where absent.
        seeds: the first so many noise draws only; all where absent.
        several: whether it takes several trajectories at once; learnt.
    """

    name: Reference
    parameters: Parameters = Field(default_factory=dict)
    label: Label = ""
    scenarios: tuple[Label, ...] = ()
    seeds: Seeds | None = None
    several: bool = False


class MetricEntry(Strict):
    """A metric with its parameters.

    Attributes:
        name: of the metric, or its file.
        parameters: its own.
        column: name of its column in tables; learnt.
        declaration: what it says of itself, such as its unit; learnt.
    """

    name: Reference
    parameters: Parameters = Field(default_factory=dict)
    column: Label = ""
    declaration: dict[str, Any] = Field(default_factory=dict)

    @field_validator("declaration")
    @classmethod
    def _no_methods(cls, value: dict[str, Any]) -> dict[str, Any]:
        for key, item in value.items():
            if not isinstance(item, str | int | float | bool | None):
                raise ValueError(f"{key!r} of a metric must be a text or a number, got {item!r}")
        return value


#: Keys that no suite file gives: plugins do.
LEARNT = {
    ScenarioEntry: ("family",),
    SensorEntry: (),
    EstimatorEntry: ("several",),
    MetricEntry: ("column", "declaration"),
}


def tables(items: Any) -> Any:
    """Names as tables that hold nothing else."""
    if isinstance(items, list | tuple):
        return [{"name": item} if isinstance(item, str) else item for item in items]
    return items

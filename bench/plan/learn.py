"""What a suite learns from the plugins it names: labels, families, declarations, files."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from olne_bench import plugins as registry
from olne_bench.bench.plan.entries import (
    EstimatorEntry,
    MetricEntry,
    PluginEntry,
    ScenarioEntry,
    SensorEntry,
)
from olne_bench.bench.plan.suite import Suite
from olne_bench.errors import UserError
from olne_bench.plugins import ESTIMATOR, METRIC, SCENARIO, SENSOR, Description, Kind

#: Kind of a plugin (None if unknown), its reference and its parameters.
Question = tuple[Kind | None, str, Mapping[str, Any]]
Describe = Callable[[list[Question]], list[Description]]


def describe_here(questions: list[Question]) -> list[Description]:
    """Describe plugins in this process, where their code must be allowed to run."""
    return [registry.describe(*question) for question in questions]


def learn(suite: Suite, plugins: tuple[str, ...], describe: Describe) -> Suite:
    """The suite with the descriptions of its plugins, and with more ``plugins``, by reference."""
    metrics = _all_metrics(suite)
    questions: list[Question] = [
        *((SCENARIO, e.name, _options(suite, e)) for e in suite.scenarios),
        *((SENSOR, layer.name, layer.parameters) for e in suite.sensors for layer in e.layers),
        *((ESTIMATOR, entry.name, entry.parameters) for entry in suite.estimators),
        *((METRIC, entry.name, entry.parameters) for entry in metrics),
        *((None, plugin, {}) for plugin in plugins),
    ]
    answers = describe(questions)
    for answer in answers:
        if answer.error:
            raise UserError(answer.error)
    said = iter(answers)
    whole = suite.model_copy(
        update={
            "scenarios": tuple(_scenario(entry, next(said)) for entry in suite.scenarios),
            "sensors": tuple(_sensor(entry, said) for entry in suite.sensors),
            "estimators": tuple(_estimator(entry, next(said)) for entry in suite.estimators),
            "metrics": tuple(_metric(entry, next(said)) for entry in metrics),
        }
    )
    for plugin, answer in zip(plugins, said, strict=True):
        whole = _add(whole, plugin, answer)
    return whole


def _options(suite: Suite, scenario: ScenarioEntry) -> Mapping[str, Any]:
    """Options that the plugin takes; those of a road are of its drives."""
    return {} if suite.kind == "drives" else scenario.options


def with_named(suite: Suite, kind: Kind, names: Iterable[str], describe: Describe) -> Suite:
    """The suite with more plugins of a kind, by their names."""
    questions: list[Question] = [(kind, name, {}) for name in names]
    for (_, name, _), said in zip(questions, describe(questions), strict=True):
        if said.error:
            raise UserError(said.error)
        suite = _add(suite, name, said)
    return suite


def _all_metrics(suite: Suite) -> list[MetricEntry]:
    """The built-in metrics, with parameters that the suite gives them, then the others."""
    others = list(suite.metrics)
    own = []
    built_in = [name for name in registry.names(METRIC) if registry.is_built_in(METRIC, name)]
    for name in suite.left_out:
        if name not in built_in:
            raise UserError(
                f"suite {suite.name!r} leaves out {name!r}, which is no built-in metric; those "
                f"are: {', '.join(built_in)}"
            )
    for name in built_in:
        if name not in suite.left_out:
            given = next((entry for entry in others if entry.name == name), None)
            own.append(given or MetricEntry(name=name))
            if given is not None:
                others.remove(given)
    return [*own, *others]


def _add(suite: Suite, plugin: str, said: Description) -> Suite:
    entry: Any
    if said.kind == SCENARIO.name:
        given = ScenarioEntry(name=plugin, trajectories=suite.trajectories)
        entry = _scenario(given, said)
    elif said.kind == SENSOR.name:
        entry = _sensor(SensorEntry(layers=(PluginEntry(name=plugin),)), iter([said]))
    elif said.kind == METRIC.name:
        entry = _metric(MetricEntry(name=plugin), said)
    else:
        entry = _estimator(EstimatorEntry(name=plugin), said)
    axis = f"{said.kind}s"
    return suite.model_copy(update={axis: (*getattr(suite, axis), entry)})


# A run may be continued from another folder, so references are absolute. Entries are built again,
# so that what a plugin declares is checked like the contents of a file.


def _scenario(entry: ScenarioEntry, said: Description) -> ScenarioEntry:
    named = dict(entry.options)
    if entry.trajectories > 1:
        named["trajectories"] = entry.trajectories
    label = entry.label or labelled(said.label, named)
    learnt = {"name": said.reference, "label": label, "family": said.family}
    return ScenarioEntry.model_validate(dict(entry) | learnt)


def _sensor(entry: SensorEntry, said: Iterator[Description]) -> SensorEntry:
    layers, labels = [], []
    for layer, about in zip(entry.layers, said, strict=False):
        layers.append(PluginEntry(name=about.reference, parameters=layer.parameters))
        labels.append(labelled(about.label, layer.parameters))
    return SensorEntry(label=entry.label or "+".join(labels), layers=tuple(layers))


def _estimator(entry: EstimatorEntry, said: Description) -> EstimatorEntry:
    label = entry.label or said.label
    learnt = {"name": said.reference, "label": label, "several": said.several}
    return EstimatorEntry.model_validate(dict(entry) | learnt)


def _metric(entry: MetricEntry, said: Description) -> MetricEntry:
    column = entry.label or said.label
    learnt = {"name": said.reference, "column": column, "declaration": said.declaration}
    return MetricEntry.model_validate(dict(entry) | learnt)


def labelled(name: str, parameters: Mapping[str, Any]) -> str:
    """Name in tables: parameters follow in parentheses."""
    listed = ",".join(f"{key}={value}" for key, value in sorted(parameters.items()))
    return f"{name}({listed})" if listed else name

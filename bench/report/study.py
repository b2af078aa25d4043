"""What the labels in a run's tables stand for, out of the suites that are stored with it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declaration_from
from olne_bench.bench.plan.suite import ScenarioEntry
from olne_bench.envs.recording import NoEquilibriumError
from olne_bench.envs.scenarios import is_family
from olne_bench.games.observation import VIEWS, View

#: What goes wrong where a label is of another version, or its truth is not to be had.
UNKNOWN_HERE = (KeyError, TypeError, ValueError, NoEquilibriumError)


@dataclass(frozen=True)
class Study:
    """Scenarios, sensors and metrics of a run.

    Attributes:
        metrics: what its metrics declare, those of this package first.
        scenarios: entries by label; a label that is not among them is a scenario's plain name.
        sensors: entries by label.
    """

    metrics: tuple[MetricDeclaration, ...] = BUILT_IN
    scenarios: Mapping[str, ScenarioEntry] = field(default_factory=dict)
    sensors: Mapping[str, Any] = field(default_factory=dict)

    def scenario(self, label: str) -> ScenarioEntry:
        """The scenario with a label; nothing says that it still exists."""
        return self.scenarios.get(label) or ScenarioEntry(name=label)

    def is_family(self, label: str) -> bool:
        """Whether every seed of the scenario with this label has a draw of its own."""
        try:
            return is_family(self.scenario(label).name)
        except ValueError:
            return True  # unknown here: the careful choice

    def view(self, sensor: str) -> View:
        """What the sensor with a label shows.

        Raises:
            ValueError: where there is none.
        """
        if sensor not in VIEWS:
            raise ValueError(f"unknown sensor {sensor!r}")
        return VIEWS[sensor]


#: The metrics of this package, and scenarios and sensors by their plain names.
USUAL = Study()


def study_of(suites: Iterable[Any]) -> Study:
    """The study of a run, whose suites may have grown from one to the next.

    Args:
        suites: as stored with the run. One that names no metrics has those of this package.
    """
    metrics: dict[str, MetricDeclaration] = {}
    scenarios: dict[str, ScenarioEntry] = {}
    sensors: dict[str, Any] = {}
    for suite in suites:
        scenarios |= {entry.label: entry for entry in suite.scenarios}
        sensors |= {getattr(s, "label", s): s for s in getattr(suite, "sensors", ())}
        declared = [_declaration(entry) for entry in getattr(suite, "metrics", ())]
        metrics |= {one.name: one for one in declared}
    return Study(_ordered(metrics) or BUILT_IN, scenarios, sensors)


def _declaration(entry: Any) -> MetricDeclaration:
    """What a suite's entry of a metric says; what is not stored is as this package has it."""
    usual = next((one.stored() for one in BUILT_IN if one.name == entry.column), {})
    told = {key: value for key, value in entry.declaration.items() if value is not None}
    return declaration_from(usual | told | {"name": entry.column})


def _ordered(found: Mapping[str, MetricDeclaration]) -> tuple[MetricDeclaration, ...]:
    usual = [one.name for one in BUILT_IN if one.name in found]
    return tuple(found[name] for name in [*usual, *(n for n in found if n not in usual)])


def why_unknown(error: Exception) -> str:
    """What is wrong, in words; some exceptions say only what they looked for."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    return text or type(error).__name__

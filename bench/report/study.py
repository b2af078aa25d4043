"""What the labels in a run's tables stand for, out of the suites that are stored with it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declaration_from
from olne_bench.bench.judge.observe import sensor_model
from olne_bench.bench.judge.referee import layers_of
from olne_bench.bench.judge.truth import Draw, noise_seed, true_recording
from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.suite import Suite
from olne_bench.envs.recording import NoEquilibriumError
from olne_bench.errors import UserError
from olne_bench.games.sensor import SensorModel

#: Errors where a label is of another version, or its truth cannot be computed.
UNKNOWN_HERE = (KeyError, TypeError, ValueError, UserError, NoEquilibriumError)


@dataclass(frozen=True)
class Study:
    """Scenarios, sensors, estimators and metrics of a run.

    Attributes:
        metrics: what its metrics declare, those of this package first.
        scenarios: entries by label.
        sensors: entries by label.
        salt: that draws and noise were seeded with.
        estimators: entries by label.
    """

    metrics: tuple[MetricDeclaration, ...] = BUILT_IN
    scenarios: Mapping[str, ScenarioEntry] = field(default_factory=dict)
    sensors: Mapping[str, SensorEntry] = field(default_factory=dict)
    salt: str = ""
    estimators: Mapping[str, EstimatorEntry] = field(default_factory=dict)

    def scenario(self, label: str) -> ScenarioEntry:
        """The scenario with a label; nothing says that it still exists.

        Raises:
            UserError: where the study has none.
        """
        return _of_label("scenario", label, self.scenarios)

    def is_family(self, label: str) -> bool:
        """Whether every seed of the scenario with this label has a draw of its own."""
        known = self.scenarios.get(label)
        return known is None or known.family  # the careful choice

    def draw(self, label: str, seed: int) -> Draw:
        """The draw that trials of a scenario's label and a seed are about.

        Raises:
            UserError: where the study has no such scenario.
        """
        return Draw.of(self.scenario(label), seed, self.salt)

    def sensor_model(self, sensor: str, draw: Draw) -> SensorModel:
        """What is known of the sensor with a label that looks at a draw.

        Raises:
            UserError: where the study has none, or it cannot be made here.
            ValueError: where it does not fit the scenario.
        """
        layers = layers_of(_of_label("sensor", sensor, self.sensors))
        return sensor_model(true_recording(draw).scenario, layers)

    def noise_seed(self, label: str, sigma: float, seed: int) -> int:
        """What the noise of trials is drawn from.

        Raises:
            UserError: where the study has no such scenario.
        """
        return noise_seed(self.scenario(label), sigma, seed, self.salt)


T = TypeVar("T")


def _of_label(what: str, label: str, known: Mapping[str, T]) -> T:
    if label not in known:
        raise UserError(f"no {what} {label!r} in the suite; it has: {', '.join(known) or 'none'}")
    return known[label]


#: The metrics of this package, of no suite in particular.
USUAL = Study()


def study_of(suites: Iterable[Suite]) -> Study:
    """The study of a run, whose suites may have grown from one to the next.

    Args:
        suites: as stored with the run. One that names no metrics has those of this package.
    """
    metrics: dict[str, MetricDeclaration] = {}
    scenarios: dict[str, ScenarioEntry] = {}
    sensors: dict[str, SensorEntry] = {}
    estimators: dict[str, EstimatorEntry] = {}
    salt = ""
    for suite in suites:
        scenarios |= {entry.label: entry for entry in suite.scenarios}
        sensors |= {entry.label: entry for entry in suite.sensors}
        estimators |= {entry.label: entry for entry in suite.estimators}
        salt = suite.salt
        declared = [_declaration(entry) for entry in suite.metrics]
        metrics |= {one.name: one for one in declared}
    return Study(_ordered(metrics) or BUILT_IN, scenarios, sensors, salt, estimators)


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

"""The entries behind the labels in a run's tables, from the suites stored with the run."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declaration_from
from olne_bench.bench.judge.observe import sensor_model
from olne_bench.bench.judge.trials import layers_of
from olne_bench.bench.judge.truth import Draw, noise_seed, true_recording
from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.truths import has_drawn_truths, is_foreign
from olne_bench.bench.report.confirmations import Confirmation
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.errors import UserError
from olne_bench.games.model.sensor import SensorModel

#: Built-in estimators that use no data, or not what they are told: they have scores, and no rank.
_FLOORS = ("uniform", "ignorant")
#: Built-in estimators that are told, or have learned, how true weights are drawn.
_KNOW_PRIOR = ("map", "posterior", "neural_posterior", "particle", "ridge", "ukf")

#: Errors raised if a label is of another version, or its truth cannot be computed.
UNKNOWN_HERE = (KeyError, TypeError, ValueError, UserError, NoEquilibriumError)


@dataclass(frozen=True)
class Study:
    """Scenarios, sensors, estimators and metrics of a run.

    Attributes:
        metrics: declarations of its metrics, the built-in ones first.
        scenarios: entries by label.
        sensors: entries by label.
        salt: salt that seeded draws and noise.
        estimators: entries by label.
        confirmations: what fresh draws said of implausible rows.
    """

    metrics: tuple[MetricDeclaration, ...] = BUILT_IN
    scenarios: Mapping[str, ScenarioEntry] = field(default_factory=dict)
    sensors: Mapping[str, SensorEntry] = field(default_factory=dict)
    salt: str = ""
    estimators: Mapping[str, EstimatorEntry] = field(default_factory=dict)
    confirmations: tuple[Confirmation, ...] = ()

    def scenario(self, label: str) -> ScenarioEntry:
        """The scenario with a label; its plugin may not exist any more.

        Raises:
            UserError: if the study has none.
        """
        return _of_label("scenario", label, self.scenarios)

    def is_family(self, label: str) -> bool:
        """Whether each seed of the scenario with this label has its own draw."""
        known = self.scenarios.get(label)
        return known is None or known.family  # the careful choice

    def has_drawn_truths(self, label: str) -> bool:
        """Whether each seed draws the true weights of the scenario with this label."""
        known = self.scenarios.get(label)
        return known is not None and has_drawn_truths(known)

    def is_published(self, label: str) -> bool:
        """Whether the true weights of the scenario with this label are known to be constants."""
        known = self.scenarios.get(label)
        return known is not None and not has_drawn_truths(known)

    def is_foreign(self, label: str) -> bool:
        """Whether the estimator with this label is known, and is a plugin."""
        known = self.estimators.get(label)
        return known is not None and is_foreign(known)

    def is_floor(self, label: str) -> bool:
        """Whether the estimator with this label is a reference that all others must beat."""
        return self._built_in(label) in _FLOORS

    def knows_prior(self, label: str) -> bool:
        """Whether the estimator with this label knows how true weights are drawn."""
        return self._built_in(label) in _KNOW_PRIOR

    def _built_in(self, label: str) -> str:
        """Name of a label's estimator, as far as it is known; for others their label."""
        known = self.estimators.get(label)
        return label if known is None else known.name

    def draw(self, label: str, seed: int) -> Draw:
        """The draw of the trials with a scenario's label and a seed.

        Raises:
            UserError: where the study has no such scenario.
        """
        return Draw.of(self.scenario(label), seed, self.salt)

    def sensor_model(self, sensor: str, draw: Draw) -> SensorModel:
        """The model of the sensor with a label on a draw.

        Raises:
            UserError: if the study has no such sensor, or it cannot be constructed here.
            ValueError: if it does not fit the scenario.
        """
        layers = layers_of(_of_label("sensor", sensor, self.sensors))
        return sensor_model(true_recording(draw).scenario, layers)

    def noise_seed(self, label: str, sigma: float, seed: int) -> int:
        """Seed of the noise of trials.

        Raises:
            UserError: where the study has no such scenario.
        """
        return noise_seed(self.scenario(label), sigma, seed, self.salt)


T = TypeVar("T")


def _of_label(what: str, label: str, known: Mapping[str, T]) -> T:
    if label not in known:
        raise UserError(f"no {what} {label!r} in the suite; it has: {', '.join(known) or 'none'}")
    return known[label]


#: A study with the built-in metrics only.
USUAL = Study()


def study_of(suites: Iterable[Suite]) -> Study:
    """The study of a run, from all its suites: a suite may grow when a run continues.

    Args:
        suites: suites stored with the run. If none names metrics, the built-in ones are used.

    Raises:
        UserError: on a suite of another kind than trials.
    """
    metrics: dict[str, MetricDeclaration] = {}
    scenarios: dict[str, ScenarioEntry] = {}
    sensors: dict[str, SensorEntry] = {}
    estimators: dict[str, EstimatorEntry] = {}
    salt = ""
    for suite in suites:
        if suite.kind != "trials":
            raise UserError(
                f"suite {suite.name!r} is a study of {suite.kind}: it has no tables of trials; "
                "'olne-bench report' writes its own"
            )
        scenarios |= {entry.label: entry for entry in suite.scenarios}
        sensors |= {entry.label: entry for entry in suite.sensors}
        estimators |= {entry.label: entry for entry in suite.estimators}
        salt = suite.salt
        declared = [_declaration(entry) for entry in suite.metrics]
        metrics |= {one.name: one for one in declared}
    return Study(_ordered(metrics) or BUILT_IN, scenarios, sensors, salt, estimators)


def _declaration(entry: Any) -> MetricDeclaration:
    """The declaration of a suite's metric; missing fields are those of the built-in metric."""
    usual = next((one.stored() for one in BUILT_IN if one.name == entry.column), {})
    told = {key: value for key, value in entry.declaration.items() if value is not None}
    return declaration_from(usual | told | {"name": entry.column})


def _ordered(found: Mapping[str, MetricDeclaration]) -> tuple[MetricDeclaration, ...]:
    usual = [one.name for one in BUILT_IN if one.name in found]
    return tuple(found[name] for name in [*usual, *(n for n in found if n not in usual)])


def why_unknown(error: Exception) -> str:
    """The message of an error; some exceptions need their type or argument instead."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    return text or type(error).__name__

"""What a run's tables are about: entries by their labels, from its suites, and its metrics."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from olne_bench.bench.judge.metrics import BUILT_IN
from olne_bench.bench.judge.metrics.declaration import MetricDeclaration, declaration_from
from olne_bench.bench.judge.priors import WITH_PRIOR
from olne_bench.bench.judge.scene import NoScenes, Scenes
from olne_bench.bench.judge.seeds import noise_seed
from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.suite import Suite, read_suite_json, salt_id
from olne_bench.bench.plan.truths import has_drawn_truths, is_foreign
from olne_bench.bench.report.confirmations import Confirmation, confirmations_of
from olne_bench.bench.run.store import Store
from olne_bench.bench.run.store_scenes import StoredScenes
from olne_bench.errors import UserError

#: Built-in estimators that use no data, or not what they are told: they have scores, and no rank.
_FLOORS = ("uniform", "ignorant")
#: Built-in estimators that are told, or have learned, how true weights are drawn.
_KNOW_PRIOR = WITH_PRIOR | {"ridge"}

#: The metric that ranks estimators if a run has it; else the first metric that is compared.
_USUAL_PRIMARY = "position_error"
#: Errors that have scores although nobody is compared by them: positive, and the less the better.
_ALSO_SCORED = ("held_out_error", "crps", "energy_score")

#: The cosine error without what the data cannot identify: a property of a scenario, all its
#: trajectories and a sensor, so ``statistics.identifiability`` computes it for a whole run.
IDENTIFIABLE = MetricDeclaration(
    "identifiable_cosine_error",
    label="identifiable error",
    worst=1.0,
    gated=True,
    negligible=1e-7,
    description="The cosine error without the part that no data of 0.01 m noise can show.",
)

#: A failure, compared like an error: 1 for an attempt without a prediction, else 0.
FAILURES = MetricDeclaration("failures", worst=1.0)


@dataclass(frozen=True)
class Study:
    """Scenarios, sensors and estimators of a run by their labels, and its metrics."""

    metrics: tuple[MetricDeclaration, ...] = BUILT_IN  # the built-in ones first
    scenarios: Mapping[str, ScenarioEntry] = field(default_factory=dict)
    sensors: Mapping[str, SensorEntry] = field(default_factory=dict)
    salt: str = ""  # of draws and noise
    estimators: Mapping[str, EstimatorEntry] = field(default_factory=dict)
    confirmations: tuple[Confirmation, ...] = ()  # what fresh draws said of implausible rows
    scenes: Scenes = field(default_factory=NoScenes)  # its truths and motions
    figures: tuple[str, ...] = ()  # kinds that are drawn; none named: all

    def scenario(self, label: str) -> ScenarioEntry:
        """The scenario with a label, whose plugin may not exist any more; UserError without one."""
        if label not in self.scenarios:
            known = ", ".join(self.scenarios) or "none"
            raise UserError(f"no scenario {label!r} in the suite; it has: {known}")
        return self.scenarios[label]

    def is_family(self, label: str) -> bool:
        """Whether each seed of a scenario has its own draw, as is assumed of an unknown one."""
        known = self.scenarios.get(label)
        return known is None or known.family

    def has_drawn_truths(self, label: str) -> bool:
        """Whether each seed draws the true weights of a scenario."""
        return label in self.scenarios and has_drawn_truths(self.scenarios[label])

    def is_published(self, label: str) -> bool:
        """Whether the true weights of a scenario are known to be constants."""
        return label in self.scenarios and not self.has_drawn_truths(label)

    def is_foreign(self, label: str) -> bool:
        """Whether an estimator is known, and is a plugin."""
        return label in self.estimators and is_foreign(self.estimators[label])

    def is_floor(self, label: str) -> bool:
        """Whether an estimator is a reference that all others must beat."""
        return self._built_in(label) in _FLOORS

    def knows_prior(self, label: str) -> bool:
        """Whether an estimator knows how true weights are drawn."""
        return self._built_in(label) in _KNOW_PRIOR

    def _built_in(self, label: str) -> str:
        """Name of a label's estimator; the label itself if it is not known."""
        return self.estimators[label].name if label in self.estimators else label

    def noise_seed(self, label: str, sigma: float, seed: int) -> int:
        """Seed of the noise of the trials of a scenario."""
        return noise_seed(self.scenario(label), sigma, seed, self.salt)


#: A study with the built-in metrics only.
USUAL = Study()


def study_in(folder: Path, store: Store) -> Study:
    """The study of a run folder, with its stored truths and its confirmations.

    UserError as of ``study_of``, and on confirmations that cannot be read.
    """
    study = study_of(read_suite_json(run.suite) for run in store.runs())
    scenes, confirmed = StoredScenes(folder, salt_id(study.salt)), confirmations_of(folder, store)
    return replace(study, scenes=scenes, confirmations=confirmed)


def study_of(suites: Iterable[Suite]) -> Study:
    """A study, without truths, from its suites, as one may grow; UserError if of another kind."""
    suites = [*suites]
    for suite in suites:
        if suite.kind != "trials":
            raise UserError(
                f"suite {suite.name!r} is a study of {suite.kind}: it has no tables of trials; "
                "'olne-bench report' writes its own"
            )
    entries: dict[str, Any] = {
        what: {entry.label: entry for suite in suites for entry in getattr(suite, what)}
        for what in ("scenarios", "sensors", "estimators")
    }
    metrics = {entry.column: _declaration(entry) for suite in suites for entry in suite.metrics}
    own = [one.name for one in BUILT_IN if one.name in metrics]
    ordered = tuple(metrics[name] for name in dict.fromkeys([*own, *metrics]))
    if suites:
        entries |= {"salt": suites[-1].salt, "figures": suites[-1].figures}
    return Study(ordered or BUILT_IN, **entries)


def _declaration(entry: Any) -> MetricDeclaration:
    """The declaration of a suite's metric; missing fields are those of the built-in metric."""
    usual = next((one.stored() for one in BUILT_IN if one.name == entry.name), {})
    told = {key: value for key, value in entry.declaration.items() if value is not None}
    return declaration_from(usual | told | {"name": entry.column})


def compared(metrics: Iterable[MetricDeclaration]) -> list[MetricDeclaration]:
    """The metrics that estimators and runs are compared by."""
    return [metric for metric in metrics if metric.compared]


def scored(metrics: Iterable[MetricDeclaration]) -> list[MetricDeclaration]:
    """The metrics that have scores: errors that are compared, held-out errors, proper scores."""
    return [metric for metric in metrics if metric.compared or metric.name in _ALSO_SCORED]


def primary(metrics: Sequence[MetricDeclaration]) -> MetricDeclaration | None:
    """The metric that estimators are ranked by; None if no metric is compared."""
    return min(compared(metrics), key=lambda m: m.name != _USUAL_PRIMARY, default=None)


def in_table(metrics: Iterable[MetricDeclaration], trials: pd.DataFrame) -> list[MetricDeclaration]:
    """The metrics with a value in a table of trials; if all failed, also the compared ones."""
    some_ok = bool(trials["status"].eq("ok").any())
    known = [metric for metric in metrics if metric.name in trials]
    return [m for m in known if worth_a_table(m, bool(trials[m.name].notna().any()), some_ok)]


def worth_a_table(metric: MetricDeclaration, valued: bool, some_ok: bool) -> bool:
    """Whether tables show a metric: some trial has a value, or all failed; no level is shown."""
    return not metric.is_level and (valued or (metric.compared and not some_ok))


def in_leaderboard(
    metrics: Iterable[MetricDeclaration], table: pd.DataFrame
) -> list[MetricDeclaration]:
    """The metrics that a leaderboard summarises, with ``IDENTIFIABLE``, in the order shown."""
    shown = [*metrics, *([] if IDENTIFIABLE in metrics else [IDENTIFIABLE])]
    return [m for m in shown if (f"{m.name}_share" if m.is_share else f"{m.name}_median") in table]

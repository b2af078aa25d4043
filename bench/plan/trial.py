"""Trials: the unit of work of a study."""

import json
import pickle
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from operator import is_
from typing import Any

from olne_bench.bench.plan.draws import DrawsSource
from olne_bench.bench.plan.entries import EstimatorEntry, MetricEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.kinds import REFERENCES, Rules, StudyKind
from olne_bench.bench.plan.suite import Suite, salt_id
from olne_bench.bench.plan.versions import VERSION_COLUMNS, Versions, versions
from olne_bench.plugins import ESTIMATOR, SCENARIO, SENSOR, is_built_in, is_file

#: Columns of a row that are known before a trial is run, and their SQL types.
LABEL_COLUMNS = {
    "suite": "TEXT",
    "scenario": "TEXT",
    "sensor": "TEXT",
    "sigma": "REAL",
    "seed": "INTEGER",
    "salt_id": "TEXT",
    "estimator": "TEXT",
    "parameters": "TEXT",
    "count": "INTEGER",
}
#: Columns of ``Trial.cell``, and of ``Trial.code``.
CELL_COLUMNS = ("scenario", "sensor", "sigma", "salt_id", "estimator")
CODE_COLUMNS = ("parameters", *VERSION_COLUMNS)
#: Columns that identify a trial.
KEY_COLUMNS = ("scenario", "sensor", "sigma", "seed", "salt_id", "estimator", "parameters")


def foreign_worlds(scenario: ScenarioEntry, sensor: SensorEntry) -> tuple[str, ...]:
    """References of a scenario and of layers of a sensor that are not built in."""
    named = [(SCENARIO, scenario.name), *((SENSOR, layer.name) for layer in sensor.layers)]
    return tuple(dict.fromkeys(name for kind, name in named if not is_built_in(kind, name)))


@dataclass(frozen=True)
class Trial:
    """One estimator on one observation, as a whole or sample by sample, or on one drive."""

    suite: str
    scenario: ScenarioEntry
    sensor: SensorEntry
    sigma: float
    seed: int  # of the noise, and of the draw where the scenario is a family
    estimator: EstimatorEntry
    metrics: tuple[MetricEntry, ...]
    count: int  # number of trials of the study that this one stands for
    time_limit: float  # wall-clock seconds for each of its stages (``bench.judge.trials``)
    root_iterations: int
    salt: str  # seeds the streams of noise and draws, together with the seed
    versions: Versions = field(default_factory=Versions)  # of the code to run it with
    draws: DrawsSource | None = None  # file that holds its truth
    kind: StudyKind = "trials"
    rules: Rules = field(default_factory=Rules)

    def __reduce__(self) -> tuple[Any, ...]:
        """Trials in a row differ by their seeds alone: the rest is pickled once."""
        return _unpickled, (_pickled(self), self.seed)

    @property
    def reference(self) -> str:
        """Which of its kind's ``REFERENCES`` it is; empty if an estimator is run."""
        return self.estimator.label if self.estimator.label in REFERENCES[self.kind] else ""

    @property
    def plugin(self) -> str:
        """Label of an estimator that is a plugin; empty for a built-in one."""
        return _plugin(self.estimator)

    @property
    def home_plugins(self) -> tuple[str, ...]:
        """References of the scenario and of sensor layers that are plugins."""
        return foreign_worlds(self.scenario, self.sensor)

    @property
    def guest_plugins(self) -> tuple[str, ...]:
        """References of the estimator and of metrics that are plugin files."""
        named = (self.estimator.name, *(metric.name for metric in self.metrics))
        return tuple(name for name in named if is_file(name))

    def versions_here(self) -> Versions:
        """The versions of the code that this process would run it with."""
        return versions(self.scenario, self.sensor, self.estimator, self.metrics, self.kind)

    def code_difference(self) -> str | None:
        """How this process's code differs from the code it was made for; None if it does not."""
        actual = self.versions_here()
        for name, subject in (
            ("estimator", f"the code of estimator {self.estimator.label!r}"),
            ("scenario", f"the code of scenario {self.scenario.label!r}"),
            ("sensor", f"the code of sensor {self.sensor.label!r}"),
            ("scoring", "the code of the scoring"),
            ("environment", "the environment (versions of libraries, compiler or none)"),
        ):
            here, there = getattr(actual, name), getattr(self.versions, name)
            if here != there:
                return f"{subject} is {here} in the worker and {there} where the run was started"
        return None

    @property
    def cell(self) -> tuple[str, str, float, str, str]:
        """What it has in common with trials of other seeds, other code and other parameters."""
        return (
            self.scenario.label,
            self.sensor.label,
            self.sigma,
            salt_id(self.salt),
            self.estimator.label,
        )

    @property
    def code(self) -> tuple[str, ...]:
        """Parameters and versions: what a row is stale by, if they are others."""
        return (self._parameters, *vars(self.versions).values())

    @property
    def _parameters(self) -> str:
        return json.dumps(self.estimator.parameters, sort_keys=True)

    @property
    def key(self) -> tuple[str, ...]:
        """What identifies the trial, whatever the version of the code."""
        labels = self.labels
        return tuple(str(labels[column]) for column in KEY_COLUMNS)

    @property
    def labels(self) -> dict[str, Any]:
        """The columns of the trial's row that are known before it is run."""
        scenario, sensor, sigma, salt, estimator = self.cell
        values = (self.suite, scenario, sensor, sigma, self.seed, salt, estimator)
        return dict(zip(LABEL_COLUMNS, (*values, self._parameters, self.count), strict=True))


_last: tuple[tuple[Any, ...], bytes] = ((), b"")


def _pickled(trial: Trial) -> bytes:
    """All but the seed."""
    global _last
    rest = {name: value for name, value in vars(trial).items() if name != "seed"}
    same = len(_last[0]) == len(rest) and all(map(is_, rest.values(), _last[0]))
    if not same:
        _last = tuple(rest.values()), pickle.dumps(rest)
    return _last[1]


@lru_cache(maxsize=64)
def _rest(pickled: bytes) -> dict[str, Any]:
    return dict(pickle.loads(pickled))


def _unpickled(pickled: bytes, seed: int) -> Trial:
    return Trial(**_rest(pickled), seed=seed)


def number_of_trials(suite: Suite, seeds: int | None = None) -> int:
    """How many trials ``expand`` yields."""
    total = 0
    for scenario, estimator in suite.pairs():
        most = min(suite.seeds_of(scenario, estimator), seeds or suite.seeds)
        for sigma in suite.sigmas_of(scenario):
            total += 1 if sigma == 0 and not scenario.family else most
    return total * len(suite.sensors)


def expand(
    suite: Suite, seeds: int | None = None, draws: DrawsSource | None = None
) -> Iterator[Trial]:
    """All trials of a suite, whose truths are in a file of ``draws``, or else are solved.

    A worker builds the solvers of a game, sensor and estimator once and keeps the latest ones. So
    the seed changes fastest in a fixed scenario, and slowest in a family, where each seed draws
    another game. Of each, the first ``seeds`` are used. Default: all.
    """
    numbers = range(min(seeds or suite.seeds, suite.seeds))
    for scenario in suite.scenarios:
        places = list(_places(suite, scenario, draws))
        for part in (range(k, k + 1) for k in numbers) if scenario.family else (numbers,):
            for place in places:
                for first, own in _levels(suite, scenario, place, part):
                    yield from (first if k == first.seed else replace(first, seed=k) for k in own)


def alike(suite: Suite) -> Iterator[tuple[Trial, range]]:
    """Trials of a suite that differ in nothing but the seed: the first one, and the seeds."""
    seeds = range(suite.seeds)
    for scenario in suite.scenarios:
        for place in _places(suite, scenario):
            yield from _levels(suite, scenario, place, seeds)


def in_order_of_plugins(
    suite: Suite, seeds: int | None = None, draws: DrawsSource | None = None
) -> Iterator[Trial]:
    """All trials as of ``expand``, those of built-in estimators first, then plugin by plugin."""
    groups: dict[str, list[EstimatorEntry]] = {}
    for estimator in suite.estimators:
        groups.setdefault(_plugin(estimator), []).append(estimator)
    for name in sorted(groups):
        part = suite.model_copy(update={"estimators": tuple(groups[name])})
        yield from expand(part, seeds, draws)


def _plugin(estimator: EstimatorEntry) -> str:
    return "" if is_built_in(ESTIMATOR, estimator.name) else estimator.label


def _places(
    suite: Suite, scenario: ScenarioEntry, draws: DrawsSource | None = None
) -> Iterator[Trial]:
    """A trial of each sensor and estimator, which the others of the scenario differ from."""
    # A trial does not depend on the selection of noise that it is run in.
    bare = scenario.model_copy(update={"sigmas": (), "seeds": None})
    estimators = [estimator for entry, estimator in suite.pairs() if entry == scenario]
    # Metrics score trials; other kinds have errors of their own.
    metrics = suite.metrics if suite.kind == "trials" else ()
    for sensor, estimator in product(suite.sensors, estimators):
        yield Trial(
            suite=suite.name,
            scenario=bare,
            sensor=sensor,
            sigma=0.0,
            seed=0,
            estimator=estimator,
            metrics=metrics,
            count=1,
            time_limit=suite.time_limit,
            root_iterations=suite.root_iterations,
            draws=draws,
            salt=suite.salt,
            versions=versions(scenario, sensor, estimator, metrics, suite.kind),
            kind=suite.kind,
            rules=suite.rules,
        )


def _levels(
    suite: Suite, scenario: ScenarioEntry, place: Trial, seeds: range
) -> Iterator[tuple[Trial, range]]:
    """The first trial at each noise level, and the seeds of all."""
    most = suite.seeds_of(scenario, place.estimator)
    own = range(seeds.start, min(seeds.stop, most))
    for sigma in suite.sigmas_of(scenario) if own else ():
        same = not scenario.family and sigma == 0
        first = replace(place, sigma=sigma, seed=own.start, count=most if same else 1)
        yield first, own[:1] if same else own

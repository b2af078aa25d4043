"""Run an estimator in this process: nothing isolates it, and nothing stops it.

What it is given is copied, so that it changes nothing and remembers nothing. But it could look for
the truth, which is in the same process. Studies (``olne_bench.run``) use processes instead.
"""

import time
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from olne_bench import plugins
from olne_bench.bench.judge.metrics.judged import Judged
from olne_bench.bench.judge.metrics.scoring import MetricError
from olne_bench.bench.judge.players import Answer, PlayerFault, PlayerTask
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError, RawEstimate, read_estimate
from olne_bench.bench.plan.entries import EstimatorEntry, MetricEntry
from olne_bench.bench.plan.learn import labelled
from olne_bench.bench.run.player import BUDGET, changes, describe_problem, why_declined
from olne_bench.estimators.protocol import Observation, Problem


class DeclinedError(ValueError):
    """An estimator says that it cannot take a problem; the message has the reason."""


@dataclass(frozen=True)
class ChosenEstimator:
    """An estimator as an object, with its entry in a suite."""

    made: Any
    entry: EstimatorEntry


def chosen_estimator(given: Any, label: str = "") -> ChosenEstimator:
    """An estimator from a name, a class or an object."""
    made = plugins.make(plugins.ESTIMATOR, given) if isinstance(given, str) else given
    made = made() if isinstance(made, type) and hasattr(made, "estimate") else made
    if isinstance(made, type) or not callable(getattr(made, "estimate", None)):
        known = ", ".join(plugins.names(plugins.ESTIMATOR))
        raise TypeError(
            f"an estimator is a name ({known}), or a class or an object with a method estimate, "
            f"got {given!r}"
        )
    name = str(getattr(made, "name", type(made).__name__))
    ours = name in plugins.names(plugins.ESTIMATOR) and type(made) is plugins.find_class(
        plugins.ESTIMATOR, name
    )
    parameters = _unusual(made) if ours else {}
    reference = name if ours else f"object {name}"
    label = label or labelled(name, parameters)
    return ChosenEstimator(made, EstimatorEntry(name=reference, parameters=parameters, label=label))


def _unusual(made: Any) -> dict[str, Any]:
    """Parameters of a built-in estimator that are not the usual ones."""
    if not is_dataclass(made):
        return {}
    given = {f.name: (getattr(made, f.name), f.default) for f in fields(made) if f.init}
    return {name: value for name, (value, usual) in given.items() if value != usual}


def estimated_here(
    estimator: Any, problem: Problem, observations: Sequence[Observation], seed: int, budget: float
) -> RawEstimate:
    """One estimate by a copy of an estimator, from copies of what it may know."""
    own, told = deepcopy(estimator), deepcopy(problem)
    before = describe_problem("", told)
    if reason := why_declined(own, told, len(observations)):
        raise DeclinedError(reason)
    shown = tuple(_copied(one) for one in observations)
    result = own.estimate(
        told, shown if len(shown) > 1 else shown[0], rng=np.random.default_rng(seed), budget=budget
    )
    if changed := changes("", told, before):
        raise InvalidEstimateError(changed)
    return read_estimate(result)


def _copied(seen: Observation) -> Observation:
    """A copy that cannot be written, as an estimator receives it in a study."""
    y = np.array(seen.y, dtype=float)
    extra = None if seen.extra is None else np.array(seen.extra, dtype=float)
    for array in (y, extra):
        if array is not None:
            array.setflags(write=False)
    return Observation(y, extra)


class PlayerHere:
    """A player without a process."""

    def __init__(self, estimator: Any) -> None:
        self._estimator = estimator

    def estimate(self, task: PlayerTask) -> Answer:
        """The estimator's answer."""
        started = time.perf_counter()
        given = (task.problem, task.observations, task.seed, BUDGET * task.time_limit)
        try:
            found = estimated_here(self._estimator, *given)
        except DeclinedError as reason:
            return Answer(declined=str(reason))
        except InvalidEstimateError as error:
            raise PlayerFault("invalid", str(error), time.perf_counter() - started) from error
        except (Exception, SystemExit) as error:
            raise PlayerFault("crash", plugins.describe_foreign_error(error)) from error
        return Answer(estimate=found, seconds=time.perf_counter() - started)


class NoForeignMetrics:
    """Comparisons use built-in metrics only."""

    def score(
        self, metric: MetricEntry, case: Judged, homes: Sequence[str], seconds: float
    ) -> float | None:
        """Refuse."""
        raise MetricError(f"metric {metric.name!r} is not built in")

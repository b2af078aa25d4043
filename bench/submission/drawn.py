"""Judge estimators that were submitted on fixed truths on truths that are drawn.

Published weights are constants: a plugin that returns them has no error, whatever it sees. So rows
of fixed truths rank nobody who is not of this package. On the same scenarios with drawn weights it
shows what an estimator can do: its error over that of ``REFERENCE``, on the same trials. Where that
ratio is ``MOST_SHIFT`` times the one on fixed truths, the estimator knows these, and is refused.
"""

import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.plan.truths import drawn_twin, has_drawn_truths
from olne_bench.bench.submission.rows import Key

#: The built-in estimator beside which errors are seen: it reaches the statistical limit.
REFERENCE = EstimatorEntry(name="kkt_constrained", label="kkt_constrained", several=True)
#: An honest estimator's ratio differs between fixed and drawn truths, by ten at most.
MOST_SHIFT = 1000.0
#: Number of drawn trials of each scenario, and of submitted ones beside them.
PAIRS = 12
_SMALLEST, _LARGEST = 1e-12, 1e6


@dataclass(frozen=True)
class Pair:
    """A trial of a submitted estimator, and the same of the reference."""

    own: Trial
    reference: Trial


@dataclass(frozen=True)
class Plan:
    """Trials of an estimator in a scenario of fixed truths, and in its twin of drawn ones."""

    estimator: str
    scenario: str
    fixed: tuple[Pair, ...]
    drawn: tuple[Pair, ...]

    @property
    def trials(self) -> list[Trial]:
        """What has to be run: submitted trials have their row."""
        own = [pair.own for pair in self.drawn]
        return own + [pair.reference for pair in (*self.fixed, *self.drawn)]


@dataclass(frozen=True)
class DrawnErrors:
    """How an estimator of fixed truths does on drawn ones."""

    estimator: str
    scenario: str
    trials: int  # on drawn truths that could be compared
    fixed: float  # median of its error over that of the reference, on fixed truths
    drawn: float  # the same on drawn ones; NaN if there are none
    error: float  # median on drawn truths
    reference: float  # the same of the reference

    @property
    def accepted(self) -> bool:
        """Whether it is about as good on drawn truths as on fixed ones."""
        return not self.drawn > MOST_SHIFT * self.fixed


def fixed_scenarios(trials: Sequence[Trial]) -> list[ScenarioEntry]:
    """Scenarios of these trials whose truths are constants, each once."""
    found = {trial.scenario.label: trial.scenario for trial in trials}
    return [entry for entry in found.values() if not has_drawn_truths(entry)]


def drawn_plans(trials: Sequence[Trial], rng: np.random.Generator) -> list[Plan]:
    """What shows how the plugins among these trials do on drawn truths."""
    plans = []
    for entry in fixed_scenarios(trials):
        twin = drawn_twin(entry)
        own = [t for t in trials if t.plugin and t.scenario.label == entry.label and t.sigma > 0]
        for label in dict.fromkeys(trial.estimator.label for trial in own):
            mine = [trial for trial in own if trial.estimator.label == label]
            chosen = [mine[k] for k in rng.permutation(len(mine))[:PAIRS]]
            salt = secrets.token_hex(16)
            drawn = [
                replace(chosen[k % len(chosen)], scenario=twin, salt=salt, seed=k)
                for k in (range(PAIRS) if twin else ())
            ]
            fixed = tuple(map(_pair, chosen)) if twin else ()
            plans.append(Plan(label, entry.label, fixed, tuple(map(_pair, drawn))))
    return plans


def _pair(own: Trial) -> Pair:
    other = replace(own, estimator=REFERENCE)
    return Pair(own, replace(other, versions=other.versions_here()))


def drawn_errors(
    plan: Plan, outcomes: Mapping[Key, Outcome], submitted: Mapping[Key, float], metric: str
) -> DrawnErrors:
    """Compare an estimator with the reference on fixed and on drawn truths.

    Errors of submitted trials are infinite for failures.
    """

    def error(trial: Trial) -> float:
        return _error(outcomes[trial.key], metric)

    fixed = [(submitted[p.own.key], error(p.reference)) for p in plan.fixed]
    drawn = [
        (error(p.own), error(p.reference))
        for p in plan.drawn
        if outcomes[p.reference.key].status != "skipped"  # the draw has no equilibrium
    ]
    return DrawnErrors(
        plan.estimator,
        plan.scenario,
        len(drawn),
        fixed=_ratio(fixed),
        drawn=_ratio(drawn),
        error=_median([own for own, _ in drawn]),
        reference=_median([other for _, other in drawn]),
    )


def _error(outcome: Outcome, metric: str) -> float:
    value = outcome.scores.get(metric)
    return value if outcome.status == "ok" and value is not None else float("inf")


def _ratio(pairs: list[tuple[float, float]]) -> float:
    cut = np.clip(np.array(pairs, float).reshape(-1, 2), _SMALLEST, _LARGEST)
    return _median(list(cut[:, 0] / cut[:, 1]))


def _median(values: list[float]) -> float:
    # Not interpolated: there may be infinite ones.
    return sorted(values)[len(values) // 2] if values else float("nan")

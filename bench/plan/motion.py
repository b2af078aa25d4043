"""Motions: the unit of work of a study in which estimates are made while a motion goes on.

A motion is a trial whose observation is handed out one sample at a time. What the referee itself
compares estimators with is run like an estimator, under a name of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import Trial, alike, in_order_of_plugins
from olne_bench.bench.plan.versions import Versions, with_following

#: Driving straight on, going on with the present controls, a policy that was cloned from players of
#: the simulator, HighwayEnv's own drivers on its roads, those fitted to the samples so far, and the
#: true weights.
CONSTANT_VELOCITY, CONSTANT_CONTROLS = "constant_velocity", "constant_controls"
CLONED, STOCK, STOCK_FITTED, TRUE_WEIGHTS = "cloned", "stock", "stock_fitted", "true_weights"
REFERENCES = (CONSTANT_VELOCITY, CONSTANT_CONTROLS, CLONED, STOCK, STOCK_FITTED, TRUE_WEIGHTS)

#: An estimator that is always there, in the place of one in the entry of a reference.
_NONE = "uniform"


@dataclass(frozen=True)
class OnlineRules:
    """Rules of an online study.

    Attributes:
        lag: number of latest samples that count; None for all.
        deadline: time [s] in which an update has to end; None for a step of the game.
        fit_every: HighwayEnv's drivers are fitted after each sample whose number is a multiple of
            this one; None if they are not fitted.
    """

    lag: int | None = None
    deadline: float | None = None
    fit_every: int | None = None


@dataclass(frozen=True)
class Motion(Trial):
    """A trial whose samples are handed out one by one.

    Attributes:
        rules: rules of the study.
        reference: one of ``REFERENCES``, if no estimator is run.
    """

    rules: OnlineRules = OnlineRules()
    reference: str = ""

    def versions_here(self) -> Versions:
        """As of ``Trial``, with the code that hands out samples and scores predictions."""
        return with_following(super().versions_here())


def with_references(suite: Suite, rules: OnlineRules) -> Suite:
    """The suite with an entry for each of ``REFERENCES`` before the estimators."""
    names = [name for name in REFERENCES if rules.fit_every or name != STOCK_FITTED]
    entries = [EstimatorEntry(name=_NONE, label=name) for name in names]
    return suite.model_copy(update={"estimators": (*entries, *suite.estimators)})


def motions(suite: Suite, rules: OnlineRules, seeds: int | None = None) -> Iterator[Motion]:
    """All motions of a suite, those of built-in estimators first, then plugin by plugin.

    Args:
        suite: what to run, ``with_references``.
        rules: rules of the study.
        seeds: number of draws to use, from the first on. Default: all.
    """
    for trial in in_order_of_plugins(suite, seeds):
        yield _motion(trial, rules)


def alike_motions(suite: Suite, rules: OnlineRules) -> Iterator[tuple[Motion, range]]:
    """Motions that differ in nothing but the seed, as ``alike`` has trials."""
    for trial, seeds in alike(suite):
        yield _motion(trial, rules), seeds


def _motion(trial: Trial, rules: OnlineRules) -> Motion:
    given = {field.name: getattr(trial, field.name) for field in fields(Trial)}
    label = trial.estimator.label
    given["versions"] = with_following(trial.versions)
    return Motion(**given, rules=rules, reference=label if label in REFERENCES else "")

"""Trials: the unit of work of a study, and the row that it leaves behind."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from olne_bench.bench.plan.suite import EstimatorEntry, ScenarioEntry, Suite
from olne_bench.bench.plan.versions import Versions, versions
from olne_bench.envs.scenarios import is_family
from olne_bench.estimators.registry import is_built_in

#: What can become of a trial. Everything but ``ok`` and ``skipped`` is a failure.
STATUSES = (
    "ok",
    "not_converged",  # the estimator says that its result is not valid
    "failed_forward",  # no root of the game at the estimated weights was found
    "timeout",  # killed at the time limit
    "crash",  # raised an exception or took its process down
    "invalid",  # returned something that is not an estimate
    "skipped",  # says that it does not support the problem
)


@dataclass(frozen=True)
class Trial:
    """One estimator on one observation.

    Attributes:
        suite: name of the suite.
        scenario: scenario with options.
        view: name of the observation model.
        sigma: noise level.
        seed: of the noise, and of the draw where the scenario is a family.
        estimator: estimator with parameters and label.
        count: how many trials of the study this one stands for.
        time_limit: wall-clock seconds for each of its stages (``bench.judge.referee``).
        root_iterations: as in ``Suite``.
        versions: of the code that it is to be run with.
    """

    suite: str
    scenario: ScenarioEntry
    view: str
    sigma: float
    seed: int
    estimator: EstimatorEntry
    count: int
    time_limit: float
    root_iterations: int
    versions: Versions = field(default_factory=Versions)

    @property
    def plugin(self) -> str:
        """What tells apart estimators that are not built in; empty where it is."""
        return "" if is_built_in(self.estimator.name) else self.estimator.label

    @property
    def key(self) -> tuple[str, ...]:
        """What identifies the trial, whatever the version of the code."""
        return tuple(str(self.labels[column]) for column in KEY_COLUMNS)

    @property
    def labels(self) -> dict[str, Any]:
        """The columns of the trial's row that are known beforehand."""
        return {
            "suite": self.suite,
            "scenario": self.scenario.label,
            "sensor": self.view,
            "sigma": self.sigma,
            "seed": self.seed,
            "estimator": self.estimator.label,
            "parameters": json.dumps(self.estimator.parameters, sort_keys=True),
            "count": self.count,
        }


KEY_COLUMNS = ("scenario", "sensor", "sigma", "seed", "estimator", "parameters")


@dataclass(frozen=True)
class Outcome:
    """What a trial found.

    Attributes:
        status: one of ``STATUSES``.
        message: one line; empty where all is well.
        cosine_error: eqn. cosine_metric, mean over players.
        cosine_limit: its expectation for an efficient estimator (Cramer-Rao bound).
        position_error: mean absolute position difference [m] of the forward game at the estimated
            weights to the truth.
        held_out_error: the same from five other initial states nearby; None where the game has no
            root at one of them.
        covers_truth: 1 where the truth lies in the 95% ellipsoid of the estimate's covariance, 0
            where it does not; None without covariance.
        reconstruction_error: the same of the estimator's own trajectory.
        published_forward: 1 where the published study's own prediction step finds a root at the
            estimated weights, 0 where only another search does, or none
            (``games.nearest_root``).
        observation_error: mean absolute position noise [m] of the observation.
        objective: what the estimator minimised.
        truth_objective: sum of squared observation errors of the true trajectory, each over its
            noise scale.
        solve_seconds: wall-clock time of the estimate, solver construction excluded.
        weights: (N, K) nested list of estimated weights.
        extras: JSON text of what else the estimator says in finite numbers and short texts; None
            without any.
    """

    status: str
    message: str = ""
    cosine_error: float | None = None
    cosine_limit: float | None = None
    position_error: float | None = None
    held_out_error: float | None = None
    covers_truth: float | None = None
    reconstruction_error: float | None = None
    published_forward: int | None = None
    observation_error: float | None = None
    objective: float | None = None
    truth_objective: float | None = None
    solve_seconds: float | None = None
    weights: list[list[float]] | None = None
    extras: str | None = None


def expand(suite: Suite, seeds: int | None = None) -> Iterator[Trial]:
    """All trials of a suite.

    A worker builds the solvers of a game, view and estimator once and keeps the latest. So in a
    fixed scenario the seed changes fastest; in a family, where every seed has a game of its own,
    slowest.

    Args:
        suite: what to run.
        seeds: the first so many noise draws only; all where absent.
    """
    numbers = range(min(seeds or suite.seeds, suite.seeds))
    for scenario in suite.scenarios:
        if is_family(scenario.name):
            for seed in numbers:
                yield from _trials(suite, scenario, [seed])
        else:
            yield from _trials(suite, scenario, numbers, alike_without_noise=True)


def _trials(
    suite: Suite, scenario: ScenarioEntry, seeds: Sequence[int], alike_without_noise: bool = False
) -> Iterator[Trial]:
    estimators = [estimator for entry, estimator in suite.pairs() if entry == scenario]
    # A trial is the same in whatever selection of noise it is run.
    bare = scenario.model_copy(update={"sigmas": (), "seeds": None})
    for view in suite.views:
        for estimator in estimators:
            code = versions(scenario, estimator)
            most = suite.seeds_of(scenario, estimator)
            own = [seed for seed in seeds if seed < most]
            for sigma in suite.sigmas_of(scenario):
                alike = alike_without_noise and sigma == 0
                for seed in own[:1] if alike else own:
                    yield Trial(
                        suite=suite.name,
                        scenario=bare,
                        view=view,
                        sigma=sigma,
                        seed=seed,
                        estimator=estimator,
                        count=most if alike else 1,
                        time_limit=suite.time_limit,
                        root_iterations=suite.root_iterations,
                        versions=code,
                    )

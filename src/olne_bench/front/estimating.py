"""Estimate weights from one observation, in this process."""

import time
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from olne_bench.bench.judge.estimate_check import check_estimate
from olne_bench.bench.judge.fit import Fit
from olne_bench.bench.judge.raw_estimate import InvalidEstimateError
from olne_bench.estimators.protocol import Estimate, Observation, Problem, check_observation
from olne_bench.estimators.shared.fit_test import FitTest
from olne_bench.estimators.shared.trajectory_fit import guess_controls
from olne_bench.front.games import solve_olne
from olne_bench.front.in_process import chosen_estimator, estimated_here
from olne_bench.front.observing import Seen
from olne_bench.games.model.equilibrium import Equilibrium


@dataclass(frozen=True, repr=False)
class Estimated:
    """What an estimator has found.

    Attributes:
        problem: what it was told.
        observation: what it was shown.
        result: the checked estimate: states, covariance, samples and parameters, where it has them.
        label: name of the estimator.
        seconds: time that it took [s].
    """

    problem: Problem
    observation: Observation
    result: Estimate
    label: str
    seconds: float

    @property
    def weights(self) -> np.ndarray:
        """(N, K), rows sum to one."""
        return self.result.weights

    @property
    def converged(self) -> bool:
        """Whether the estimator considers the result valid."""
        return self.result.converged

    @property
    def fit(self) -> FitTest:
        """Whether noise explains what the estimate leaves: its p-value, verdict and reason."""
        return self._fit.test

    def __repr__(self) -> str:
        """One line: who has found which weights."""
        parts = [f"by {self.label!r} in {self.seconds:.2g} s"]
        parts += [f"weights {np.round(self.weights, 3).tolist()}"]
        if not self.converged:
            parts.append(f"not converged: {self.result.message or 'no reason given'}")
        return f"Estimated({'; '.join(parts)})"

    def predict(self, initial_state: np.ndarray | None = None) -> Equilibrium:
        """The motion at the estimated weights.

        Args:
            initial_state: (N, n) where it begins. Default: the estimated state, or the first
                sample where all of it was seen.

        Raises:
            ValueError: if there is no state to begin with, or no root (``NoRootError``).
        """
        game, states = self.problem.game, self.result.states
        if self.result.parameters is not None:
            game = game.known(self.result.parameters)
        start = self._start if initial_state is None else initial_state
        controls = None if states is None else guess_controls(game, states)
        return solve_olne(game, self.weights, start, initial_controls=controls)

    def summary(self) -> pd.DataFrame:
        """One row per player: weights, and their standard errors where they are known."""
        names = list(self.problem.weight_names)
        players = pd.RangeIndex(len(self.weights), name="player")
        table = pd.DataFrame(self.weights, columns=names, index=players)
        errors = self._fit.standard_errors if self.problem.sigma > 0 else None
        if errors is not None:
            table[[f"{name}_error" for name in names]] = errors
        if self.result.parameters is not None:
            used = self.problem.game.parameters
            table[[f"parameter_{k}" for k in range(used.count)]] = np.where(
                used.used, self.result.parameters, np.nan
            )
        return table

    @cached_property
    def _fit(self) -> Fit:
        return Fit(self.problem, self.observation.y, self.result)

    @property
    def _start(self) -> np.ndarray:
        if self.result.states is not None:
            return np.asarray(self.result.states[0])
        dynamics, view = self.problem.game.dynamics, self.problem.view
        first = np.asarray(self.observation.y[0], dtype=float)
        names = view.component_names(dynamics)
        if names == dynamics.state_names and np.isfinite(first).all():
            return first
        raise ValueError(
            f"{self.label!r} estimates no states, and {view.name!r} shows {', '.join(names)} only: "
            "give predict the initial_state, such as scenario.initial_state"
        )


def estimate(
    problem: Problem,
    observation: Observation,
    estimator: Any = "kkt_constrained",
    *,
    budget: float = 60.0,
    seed: int = 0,
) -> Estimated:
    """Estimate every player's weights. Nothing isolates the estimator from this process.

    Args:
        problem: what is known, from ``olne_bench.observe`` or ``olne_bench.problem``.
        observation: what was seen: (T, N, d) samples, NaN where one is missing.
        estimator: one of ``olne_bench.estimators()``, or a class or an object with a method
            ``estimate``.
        budget: time that the search may take [s].
        seed: seed of the estimator's random numbers.

    Raises:
        TypeError: on an estimator, problem or observation that is something else.
        ValueError: on an unknown name, an observation that does not fit the problem or was made
            with other noise scales, a problem that the estimator declines, or a result that is no
            estimate. An exception of the estimator itself is not caught.
    """
    chosen = chosen_estimator(estimator)
    _check(problem, observation)
    started = time.perf_counter()
    try:
        raw = estimated_here(chosen.made, problem, (observation,), seed, budget)
        result = check_estimate(raw, problem)
    except InvalidEstimateError as error:
        raise ValueError(f"estimator {chosen.entry.label!r}: {error}") from error
    seconds = time.perf_counter() - started
    return Estimated(problem, observation, result, chosen.entry.label, seconds)


def _check(problem: object, observation: object) -> None:
    for name, value, kind in (
        ("problem", problem, Problem),
        ("observation", observation, Observation),
    ):
        if not isinstance(value, kind):
            raise TypeError(
                f"{name} must be a {kind.__name__}, as observe(scenario) returns it, got {value!r}"
            )
    assert isinstance(problem, Problem) and isinstance(observation, Observation)
    check_observation(problem, observation)
    if isinstance(observation, Seen) and not np.allclose(
        problem.noise_scale, observation.noise_scale
    ):
        raise ValueError(
            f"the problem has the noise scales {problem.noise_scale}, the observation was made "
            f"with {observation.noise_scale}; use the problem that observe(scenario) returns, or "
            "problem(scenario, sensor, sigma)"
        )

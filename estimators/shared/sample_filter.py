"""What ``ukf`` and ``particle`` share: trajectories are filtered in turn, one sample at a time."""

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from olne_bench.estimators.protocol import COVARIANCE, POSTERIOR, Estimate, Observation, Problem
from olne_bench.estimators.shared.belief import (
    FollowedGames,
    Gaussian,
    LostError,
    hidden_positions,
    lost_estimate,
)
from olne_bench.estimators.shared.forward_model import (
    scaled_samples,
    squared_error_of,
    warm_up_games,
)
from olne_bench.estimators.shared.joint_starts import unexplained
from olne_bench.estimators.shared.noise_level import telling_noise, with_found_noise
from olne_bench.estimators.shared.past_posterior import Outset, outset
from olne_bench.estimators.shared.white_noise import assumed_sigma, white_problem, with_white_noise


class FilterRun(ABC):
    """One estimate, which filters trajectories in turn.

    Mean weights (N, K) are ``online`` after each measurement so far. The belief is None before the
    first trajectory; the message is one line if it failed.
    """

    games: FollowedGames

    def __init__(self, problem: Problem, spread: float, deadline: float, *, peek: bool) -> None:
        self._problem, self._spread = problem, spread
        self._deadline, self._peek = deadline, peek
        self.sigma = assumed_sigma(problem)
        self.online: list[np.ndarray] = []
        self.belief: Gaussian | None = None
        self._first_states: np.ndarray | None = None
        self._trajectories = 0
        self._objective, self.message, self.remarks = 0.0, "", list[str]()

    @abstractmethod
    def filtered(self, begin: Outset, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Append to ``online`` for samples (T, N*d); mean (n,) and covariance at the end."""

    @abstractmethod
    def certainty(self) -> tuple[np.ndarray, dict[str, Any]]:
        """The covariance of the weights (N*K, N*K), and further extras of the estimate."""

    def take_in(self, observation: Observation) -> None:
        """Filter a trajectory from the current belief about the weights; LostError if it fails."""
        problem, given = self._problem, (self.belief, self._spread, self._deadline)
        begin = outset(problem, observation, *given, peek=self._peek)
        self.games = begin.games
        self._trajectories += 1
        self.online += [begin.games.mean_weights(begin.prior)] * begin.first
        mean, covariance = self.filtered(begin, scaled_samples(problem, observation.y))
        states = begin.games.play(mean).root.states
        error = squared_error_of(problem, states, observation.y)
        if not self._peek:
            self.remarks.append(unexplained(problem, error, [observation.y]))
        self._objective += error
        self._first_states = states if self._first_states is None else self._first_states
        self.belief = Gaussian(mean[: begin.games.chart.size], covariance)

    def lost(self, message: str) -> Estimate:
        """What was known when the filter could not continue."""
        return lost_estimate(self._problem, self.online, message)

    def estimate(self) -> Estimate:
        """The last belief."""
        belief, games = self.belief, self.games
        assert belief is not None, "there is at least one observation"
        covariance, extras = self.certainty()
        known = {"objective": self._objective, "online_weights": np.array(self.online)}
        return Estimate(
            weights=self.online[-1],
            states=self._first_states,
            covariance=covariance,
            region=POSTERIOR if self._trajectories == 1 else COVARIANCE,
            parameters=games.parameters(belief.mean),
            parameter_deviations=games.parameter_deviations(belief),
            converged=not self.message,
            message="; ".join(filter(None, dict.fromkeys([self.message, *self.remarks]))),
            extras=known | extras,
        )


class SampleFilter(ABC):
    """An estimator that makes a ``FilterRun``."""

    several: ClassVar[bool] = True

    @abstractmethod
    def run(self, problem: Problem, deadline: float, rng: np.random.Generator) -> FilterRun:
        """A run of a problem whose noise is white, until ``time.monotonic`` is the deadline."""

    def estimate(
        self,
        problem: Problem,
        observation: Observation | Sequence[Observation],
        *,
        rng: np.random.Generator,
        budget: float,
    ) -> Estimate:
        problem, observations = with_white_noise(problem, observation)
        deadline = time.monotonic() + budget
        asked, problem = problem, with_found_noise(problem, observations, deadline)
        run = self.run(problem, deadline, rng)
        try:
            for one in observations:
                run.take_in(one)
        except LostError as error:
            return run.lost(str(error))
        return telling_noise(run.estimate(), asked, problem)

    def supports(self, problem: Problem) -> str | None:
        """Why this problem cannot be filtered, or None."""
        return hidden_positions(problem)

    def warm_up(self, problem: Problem) -> None:
        """Build the solvers."""
        warm_up_games(white_problem(problem))

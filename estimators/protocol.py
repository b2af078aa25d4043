"""What an estimator receives and returns. This is all that a plugin author needs to read.

The protocol is structural: an estimator is any class with a method ``estimate`` of the signature
below. It may be a dataclass, whose fields are then its parameters. It may return an ``Estimate``
or any object with the same attributes, of which only ``weights`` is required. Ground truth never
reaches it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from olne_bench.games.model.game import Game
from olne_bench.games.model.observation import View, observation_size, whitening
from olne_bench.games.model.weight_prior import FLAT, WeightPrior

#: A p-value of the fit test below this says that the model does not fit.
FIT_LEVEL = 0.01


@dataclass(frozen=True)
class Problem:
    """What is known about the game before anything is observed.

    Raises TypeError on a game, view or prior that is something else, such as a sensor's name;
    ValueError on a number or an array out of range.

    Attributes:
        game: players' features and tasks, motion model, horizon T and step dt [s]; no weights.
        view: observation model h, shared by all players: y = h(x) + noise, then gaps.
        sigma: noise level, at least 0, or its median where it is not known: observed component k
            has Gaussian noise of standard deviation ``sigma * noise_scale[k]``, independent between
            players and times. Noise on an angle is not wrapped (``games.model.observation``).
        weight_floor: smallest weight allowed, given rows that sum to one.
        noise_scale: (d,) relative standard deviations, by which likelihoods divide residuals in
            metres, radians and metres per second. Ones if empty, as in the paper.
        noise_covariance: (d, d) of a player's components, relative to sigma^2, its diagonal the
            squares of ``noise_scale``; None if independent. ``estimators.shared.white_noise``
            whitens it.
        goes_on: whether players plan again all the time, each time T states ahead. What a stream
            (``estimators.shared.incoming_samples``) has seen last is then the start of a game.
        sigma_spread: standard deviation of log sigma where the noise level is not known; 0 where it
            is. An estimate then tells the level that it found as ``extras["sigma"]``.
        prior: what is known of each player's weights before, flat by default; only Bayesian methods
            read it. Unknowns carry their own (``Game.parameters``).
    """

    game: Game
    view: View
    sigma: float = 0.0
    weight_floor: float = 1e-5
    noise_scale: tuple[float, ...] = ()
    noise_covariance: tuple[tuple[float, ...], ...] | None = None
    goes_on: bool = False
    prior: WeightPrior = FLAT
    sigma_spread: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.game, Game):
            raise TypeError(
                f"game must be a Game, got {self.game!r}; "
                "olne_bench.observe makes the problem of a scenario"
            )
        if not isinstance(self.view, View):
            raise TypeError(
                f"view must be a View, such as FullView(), got {self.view!r}; "
                "olne_bench.problem takes names of sensors"
            )
        if not isinstance(self.prior, WeightPrior):
            raise TypeError(f"prior must be a WeightPrior, got {self.prior!r}")
        self.prior.check(self.game.num_weights)
        if not (math.isfinite(self.sigma) and self.sigma >= 0):
            raise ValueError(f"sigma must be a finite number of at least 0, got {self.sigma}")
        if not (math.isfinite(self.sigma_spread) and self.sigma_spread >= 0):
            raise ValueError(
                f"sigma_spread must be a finite number of at least 0, got {self.sigma_spread}"
            )
        if self.sigma_spread and not self.sigma:
            raise ValueError("a noise level that is not known needs a sigma above 0, its median")
        largest = 1 / self.game.num_weights
        if not 0 <= self.weight_floor < largest:
            raise ValueError(
                f"weight_floor must be at least 0 and below {largest:g} for "
                f"{self.game.num_weights} weights per player, got {self.weight_floor}"
            )
        size = observation_size(self.view, self.game.dynamics)
        if self.noise_covariance is not None:
            self._check_covariance(self.noise_covariance, size)
        scale = tuple(float(value) for value in self.noise_scale) or (1.0,) * size
        if len(scale) != size or not all(math.isfinite(s) and s > 0 for s in scale):
            raise ValueError(
                f"noise_scale must hold {size} positive numbers for the view {self.view.name!r}, "
                f"got {self.noise_scale}"
            )
        object.__setattr__(self, "noise_scale", scale)

    def _check_covariance(self, rows: Sequence[Sequence[float]], size: int) -> None:
        """Check the covariance; store it as tuples and the roots of its diagonal as noise scale."""
        whitening(rows)
        if len(rows) != size:
            raise ValueError(
                f"noise_covariance must have {size} rows for the view {self.view.name!r}, "
                f"got {len(rows)}"
            )
        covariance = tuple(tuple(float(value) for value in row) for row in rows)
        deviations = tuple(float(covariance[k][k]) ** 0.5 for k in range(size))
        if self.noise_scale and not np.allclose(self.noise_scale, deviations):
            raise ValueError(
                f"noise_scale {self.noise_scale} is not the root of the diagonal of "
                f"noise_covariance, {deviations}"
            )
        object.__setattr__(self, "noise_covariance", covariance)
        object.__setattr__(self, "noise_scale", deviations)

    def __repr__(self) -> str:
        """One line: the game, what is seen of it, and the noise."""
        names = self.view.component_names(self.game.dynamics)
        scales = ", ".join(f"{s:g}" for s in self.noise_scale)
        return (
            f"Problem({self.game!r}; seen through {self.view.name!r}: {', '.join(names)}; "
            f"noise {self.sigma:g} times {scales})"
        )

    @property
    def weight_names(self) -> tuple[str, ...]:
        """Names of the K weights of each player, in column order."""
        return self.game.weight_names


@dataclass(frozen=True)
class Observation:
    """One recorded sequence.

    Attributes:
        y: (T, N, d) observations h(x_t^i) + noise; a missing sample is NaN, never zero.
        extra: (N, d) one more sample, at T+1, or None, with which the published baseline's
            pre-filter finds the last speed.
    """

    y: np.ndarray
    extra: np.ndarray | None = None

    def __repr__(self) -> str:
        """One line: the shape of the samples, and how many are missing."""
        shape = " x ".join(map(str, np.shape(self.y)))
        missing = int(np.isnan(np.asarray(self.y, dtype=float)).sum())
        return f"Observation({shape} samples (time, player, component), {missing} of them missing)"


def check_observations(
    problem: Problem, observation: "Observation | Sequence[Observation]"
) -> tuple[Observation, ...]:
    """One or several observations as a tuple; ValueError on none, and as ``check_observation``."""
    several = tuple(observation) if isinstance(observation, Sequence) else (observation,)
    if not several:
        raise ValueError("at least one observation is needed, got none")
    for one in several:
        check_observation(problem, one)
    return several


def check_observation(problem: Problem, observation: Observation) -> None:
    """Check an observation, NaN where missing; ValueError on a wrong shape, or on infinity."""
    size = observation_size(problem.view, problem.game.dynamics)
    shape = (*problem.game.state_shape[:2], size)
    _check_samples("y", observation.y, shape, problem.view)
    if observation.extra is not None:
        _check_samples("extra", observation.extra, shape[1:], problem.view)


def _check_samples(name: str, samples: np.ndarray, shape: tuple[int, ...], view: View) -> None:
    samples = np.asarray(samples, dtype=float)
    if samples.shape != shape:
        raise ValueError(
            f"observation.{name} has the shape {samples.shape}, expected {shape} "
            f"for the view {view.name!r}"
        )
    if np.isinf(samples).any():
        raise ValueError(f"observation.{name} has infinite entries; a missing sample is NaN")


#: Kinds of regions that an estimate may claim.
SAMPLES, COVARIANCE = "samples", "covariance"
LIKELIHOOD, POSTERIOR = "likelihood", "posterior"
REGIONS = (SAMPLES, COVARIANCE, LIKELIHOOD, POSTERIOR)


@dataclass(frozen=True)
class Estimate:
    """What an estimator returns.

    Attributes:
        weights: (N, K), non-negative; scaled to row sums of one by the harness.
        states: (T, N, n) reconstructed trajectory, the first of several, or None.
        covariance: (N*K, N*K) of the weights, rows scaled to sum one, in C order, or None.
        region: where the truth is expected: ``samples``, a quantile of their distances,
            ``covariance``, an ellipsoid, or all weights whose profile of the ``likelihood`` or
            ``posterior`` is high enough, which the referee computes (one trajectory only). None:
            the first one there is.
        parameters: (N, U) the game's unknowns (``Game.parameters``) in their units; None without.
            Columns that stand for nothing are not read.
        parameter_deviations: (N, U) their standard deviations, or None.
        samples: (M, N, K) weights of equal probability, M of 40 to 4000, or None; scaled likewise.
        parameter_samples: (M, N, U) values of the game's unknowns that belong to them, or None.
        converged: whether the method itself considers the result valid.
        message: one line that explains a failure.
        extras: further results, by name. ``objective`` is stored with the trial, as are other
            finite numbers and short texts, at most twenty; arrays are not.
    """

    weights: np.ndarray
    states: np.ndarray | None = None
    covariance: np.ndarray | None = None
    region: str | None = None
    parameters: np.ndarray | None = None
    parameter_deviations: np.ndarray | None = None
    samples: np.ndarray | None = None
    parameter_samples: np.ndarray | None = None
    converged: bool = True
    message: str = ""
    extras: Mapping[str, Any] = field(default_factory=dict)

    def theta(self, game: Game) -> np.ndarray:
        """(N, K + U): weights and standardised parameters, as solvers of a game take them."""
        if self.parameters is None:
            return self.weights
        return np.hstack([self.weights, game.parameters.standardised(self.parameters)])

    def sampled_theta(self, game: Game, most: int) -> np.ndarray | None:
        """(M, N, K + U) of so many samples at most, evenly spaced; None without samples."""
        if self.samples is None or (game.parameters.count and self.parameter_samples is None):
            return None
        chosen = np.linspace(0, len(self.samples) - 1, min(most, len(self.samples))).astype(int)
        if self.parameter_samples is None:
            return np.asarray(self.samples[chosen])
        unknown = [game.parameters.standardised(one) for one in self.parameter_samples[chosen]]
        return np.concatenate([self.samples[chosen], unknown], axis=2)

    def __repr__(self) -> str:
        """One line: the weights, what else there is, and whether it is valid."""
        given = [
            name
            for name in ("states", "covariance", "samples", "parameters")
            if getattr(self, name) is not None
        ]
        parts = [f"weights {np.round(self.weights, 3).tolist()}"]
        parts += [f"with {', '.join(given)}"] if given else []
        parts += [] if self.converged else [f"not converged: {self.message or 'no reason given'}"]
        return f"Estimate({'; '.join(parts)})"


class Estimator(Protocol):
    """An inverse-game estimator.

    Two further methods are used if they exist: ``supports(problem) -> str | None`` says why the
    estimator cannot take a problem (the trial is then ``skipped``); ``warm_up(problem)`` builds
    solvers before the clock of the first trial starts.

    An estimator that can explain several trajectories of the same players by one set of weights
    sets the class attribute ``several = True``, and then receives a tuple of them; without it,
    trials with more than one are ``skipped``. Its method ``supports_several(problem) -> str |
    None`` says why it cannot do so for a problem, or None.
    """

    def estimate(
        self, problem: Problem, observation: Any, *, rng: np.random.Generator, budget: float
    ) -> Estimate:
        """Estimate every player's weights.

        Args:
            problem: what is known. It is a copy and must not be changed.
            observation: what was seen, which must not be changed: an ``Observation`` or, with
                ``several``, a tuple of two or more, each with its own initial state.
            rng: the only source of randomness, seeded per trial.
            budget: wall-clock seconds for the search. One that has not ended by then ends there,
                and ``converged`` is False, or ``message`` names the time. Before that, counts limit
                what is tried, never the clock, so that results do not depend on the machine. The
                call is stopped after the stage's time limit, of which the budget is four fifths.
        """

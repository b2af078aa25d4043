"""Samples of an amortised posterior: a network that was trained on draws of the simulator.

Neural posterior estimation: pairs of weights, drawn from their prior, and noisy observations of
their equilibria are simulated once. In coordinates z of all players' weights in which their prior
is standard normal (``charts``), the network maximises

    (N1)  E[log q(z | y, sigma)]

over them, which among all densities the posterior does. Then one pass through the network is an
estimate. There is one network for each known game, and its file is part of this package;
``scripts/train_learned.py posterior`` trains it.

Paper: after Papamakarios and Murray 2016 (mixture density network), Greenberg et al. 2019.
Assumes: a game that it was trained for, starts near those of the scenario, and independent noise of
    a level that it was trained for. Samples are drawn again by weight where the prior is not flat.
Cost: milliseconds, no games; before that, 10,000 to 20,000 games and minutes of training, once.
Trust: as a fast guess. Its coverage is tested on few draws only, and nothing shows when an
    observation is unlike its training draws.
"""

import hashlib
import re
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np

from olne_bench.checks import check_count
from olne_bench.estimators.protocol import Estimate, Observation, Problem, check_observation
from olne_bench.estimators.shared.charts import NormalChart
from olne_bench.estimators.shared.forward_model import uniform_weights
from olne_bench.estimators.shared.mixture_network import MixtureNetwork
from olne_bench.estimators.shared.perturbed_fits import resampled
from olne_bench.games.model.game import Game
from olne_bench.games.model.weight_prior import FLAT

#: Networks and the scenarios that they are called after, beside this file.
_FILES = {path.stem.partition(".")[2]: path for path in Path(__file__).parent.glob("neural_*.npz")}

#: Times as many samples are drawn where the prior is another one than that of the training.
_MORE = 8

_NUMBER = re.compile(r"-?\d+\.\d*(e[+-]?\d+)?|-?\d+e[+-]?\d+")


@dataclass(frozen=True)
class NeuralPosterior:
    """Samples of weights from a trained network.

    There are ``count`` of them; ValueError if that is out of range.
    """

    name: ClassVar[str] = "neural_posterior"
    count: int = 1000

    def __post_init__(self) -> None:
        check_count("count", self.count, least=40, most=4000)

    def estimate(
        self, problem: Problem, observation: Observation, *, rng: np.random.Generator, budget: float
    ) -> Estimate:
        check_observation(problem, observation)
        reason = self.supports(problem)
        if reason is not None:
            return Estimate(weights=uniform_weights(problem), converged=False, message=reason)
        game = problem.game
        states = states_of(problem, observation)
        chart = NormalChart.of(replace(problem, prior=FLAT))  # the prior of its training
        flat = problem.prior == FLAT
        drawn = self.count if flat else _MORE * self.count
        samples = chart.weights(network_of(game).samples(states, problem.sigma, drawn, rng))
        if not flat:
            samples = samples[_resampled(problem, samples, self.count, rng)]
        return Estimate(
            weights=samples.mean(axis=0),
            covariance=np.cov(samples.reshape(self.count, -1), rowvar=False),
            samples=samples,
        )

    def supports(self, problem: Problem) -> str | None:
        """Why no network was trained for a problem; None if one was."""
        game, names = problem.game, problem.game.dynamics.state_names
        if game_key(game) not in _networks():
            return (
                f"no network was trained for this game of {game.num_players} players and "
                f"{game.horizon} steps; there are networks for: {', '.join(sorted(_FILES))}"
            )
        seen = problem.view.component_names(game.dynamics)
        if not set(seen) <= set(names):
            return f"networks see {', '.join(names)} only, and not {', '.join(seen)}"
        if problem.noise_covariance is not None or set(problem.noise_scale) != {1.0}:
            return "networks were trained for independent noise of one level on all components"
        low, high = network_of(game).sigmas
        if not low <= problem.sigma <= high:
            return (
                f"the network was trained for sigma from {low:g} to {high:g}, not {problem.sigma:g}"
            )
        return None

    def warm_up(self, problem: Problem) -> None:
        """Read the networks."""
        _networks()


def _resampled(
    problem: Problem, samples: np.ndarray, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Indices (count,) of samples (M, N, K) under a flat prior, as if under the problem's."""
    floor, free = problem.weight_floor, 1 - problem.game.num_weights * problem.weight_floor
    shares = (samples - floor) / free
    logs = (problem.prior.log_density(shares) - FLAT.log_density(shares)).sum(axis=1)
    chances = np.exp(logs - logs.max())
    return resampled(chances / chances.sum(), count, rng)


@lru_cache(maxsize=16)
def game_key(game: Game) -> str:
    """Identifies a game; numbers count to six digits, as the last ones depend on the machine."""
    text = repr((game.players, game.constraints, game.dynamics.name, game.horizon, game.dt))
    rounded = _NUMBER.sub(lambda found: f"{round(float(found[0]), 6) + 0.0:.6f}", text)
    return hashlib.sha256(rounded.encode()).hexdigest()


def network_of(game: Game) -> MixtureNetwork:
    """The network of a game that has one."""
    return _networks()[game_key(game)]


@lru_cache(maxsize=1)
def _networks() -> dict[str, MixtureNetwork]:
    networks = [MixtureNetwork.read(path) for path in _FILES.values()]
    return {network.game: network for network in networks}


def states_of(problem: Problem, observation: Observation) -> np.ndarray:
    """Samples (T, N, n) at their places in the state; NaN where nothing is seen."""
    dynamics = problem.game.dynamics
    states = np.full(problem.game.state_shape, np.nan)
    for k, name in enumerate(problem.view.component_names(dynamics)):
        states[..., dynamics.state_names.index(name)] = observation.y[..., k]
    return states

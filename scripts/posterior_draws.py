"""Draws from a prior, and what is seen of them: for scripts that judge samples of ``posterior``.

Weights are uniform on the simplex. ``posterior`` has a flat prior of x_1, of which nothing can be
drawn: where noise is high, samples around one start are not calibrated, and cannot be. So here
starts are those of the scenario plus normal errors, and the posterior knows the same prior.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from olne_bench.bench.judge.observe import observe, problem_of, sensor_model
from olne_bench.envs.recordings.recording import NoEquilibriumError, Recording, record
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.true_weights import DIRICHLET
from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.posterior_density import GameDensity, StartPrior
from olne_bench.games.model.observation import VIEWS

#: Standard deviations of starts: x, y [m], heading [rad], speed [m/s].
START_DEVIATIONS = {
    "two_player": (0.2, 0.2, 0.2, 0.1),
    "highway_overtaking": (0.1, 0.1, 0.1, 0.05),
    "highway": (0.5, 0.1, 0.01, 0.25),
    "merge": (0.5, 0.1, 0.01, 0.25),
}

#: Noise levels of a scenario [m].
SIGMAS = {
    "two_player": (0.01, 0.03, 0.1),
    "highway_overtaking": (0.005, 0.02, 0.05),
    "highway": (0.05, 0.2, 0.5),
    "merge": (0.05, 0.2, 0.5),
}


@dataclass(frozen=True)
class PosteriorOfDraws(Posterior):
    """``posterior`` with the prior of starts of one draw."""

    start: StartPrior | None = None

    def density(self, problem: Problem, observation: Observation, deadline: float) -> GameDensity:
        usual = super().density(problem, observation, deadline)
        return replace(usual, start=self.start)


@dataclass(frozen=True)
class Draw:
    """A truth, and the prior of its start."""

    seed: int
    recording: Recording
    start: StartPrior

    def seen(self, view: str, sigma: float) -> tuple[Problem, Observation]:
        """What an estimator is told, and noisy observations; noise is the same in every call."""
        layers, scenario = (VIEWS[view],), self.recording.scenario
        problem = problem_of(scenario.told, sensor_model(scenario, layers), sigma)
        noise = np.random.SeedSequence([self.seed, len(view), round(1e6 * sigma)])
        (seen,) = observe([self.recording], layers, sigma, int(noise.generate_state(1)[0]))
        return problem, seen


def draws(name: str, seeds: range) -> Iterator[Draw]:
    """Those that have a certified equilibrium."""
    players = {"num_players": 3} if name in ("highway", "merge") else {}
    for seed in tqdm(seeds, desc="draws", disable=None, leave=False):
        with suppress(NoEquilibriumError):
            scenario = get_scenario(name, seed, weights=DIRICHLET, **players)
            mean = np.asarray(scenario.initial_state)
            deviation = np.broadcast_to(START_DEVIATIONS[name], mean.shape)
            errors = np.random.default_rng([seed, 1]).standard_normal(mean.shape)
            drawn = replace(scenario, initial_state=mean + deviation * errors)
            yield Draw(seed, record(drawn), StartPrior(mean, deviation))

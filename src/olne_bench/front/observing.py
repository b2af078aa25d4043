"""Observe a scenario as a study does."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from olne_bench.bench.judge.observe import problem_of, sensor_model
from olne_bench.bench.judge.seeds import noise_seed
from olne_bench.bench.judge.trials import shown
from olne_bench.envs.scenarios import checked_seed
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.front.drawing import DrawnScenario, chosen_sensor, place_of
from olne_bench.games.model.game import Game
from olne_bench.games.model.sensor import SensorModel
from olne_bench.games.model.weight_prior import FLAT, WeightPrior


@dataclass(frozen=True, repr=False)
class Seen(Observation):
    """An observation that knows the noise it was made with.

    Attributes:
        noise_scale: (d,) standard deviations of the components, relative to sigma.
        sigma: noise level.
    """

    noise_scale: tuple[float, ...] = ()
    sigma: float = 0.0

    def __repr__(self) -> str:
        """One line: the samples and their noise."""
        scales = ", ".join(f"{s:g}" for s in self.noise_scale)
        return f"{super().__repr__()[:-1]}; noise {self.sigma:g} times {scales})"


def observe(
    scenario: str | Scenario, sensor: Any = "full", sigma: float = 0.0, seed: int | None = None
) -> tuple[Problem, Seen]:
    """Observe the equilibrium of a scenario through a sensor, with the noise of a study.

    Args:
        scenario: from ``olne_bench.scenario``, its name, or a ``Scenario`` of your own.
        sensor: one of ``olne_bench.sensors()``, an object with ``layers()``, a view, or a tuple of
            these, the innermost first.
        sigma: noise level, on roads the standard deviation of a position [m]. The scenario's noise
            scales make it that of the other components.
        seed: seed of the noise. Default: that of the scenario's draw, so that a trial of a study
            with this seed shows the same.

    Returns:
        The problem, what an estimator is told, and the observation, (T, N, d) samples.

    Raises:
        TypeError: on a scenario or a sensor that is neither a name nor an object of its kind.
        ValueError: on unknown names, with the alternatives, a sensor that does not fit the
            scenario, or a sigma or seed below 0.
        NoEquilibriumError: where a scenario has no certified equilibrium.
    """
    place, layers = place_of(scenario), chosen_sensor(sensor).layers
    _check_sigma(sigma)
    known = scenario.seed if isinstance(scenario, DrawnScenario) else 0
    number = known if seed is None else checked_seed(seed)
    noise = noise_seed(place.entry, float(sigma), number, place.salt)
    problem, (first, *_) = shown(place.at(number), layers, float(sigma), noise)
    return problem, Seen(first.y, first.extra, problem.noise_scale, problem.sigma)


def problem(
    game: Game | Scenario,
    sensor: Any = "full",
    sigma: float = 0.0,
    *,
    noise_scale: Sequence[float] | None = None,
    prior: WeightPrior | None = None,
) -> Problem:
    """What an estimator is told, for observations of your own.

    Args:
        game: a game, or a scenario, which has noise scales.
        sensor: as of ``observe``.
        sigma: noise level.
        noise_scale: (n,) standard deviation of the noise on each component of the state, relative
            to sigma. A game needs it; ones mean the same number in metres, radians and m/s.
        prior: what is known of each player's weights; that of a scenario, or flat, if None.

    Raises:
        TypeError: on another game or sensor.
        ValueError: on a game without noise scales, a sensor that does not fit, or numbers out of
            range.
    """
    layers = chosen_sensor(sensor).layers
    _check_sigma(sigma)
    if isinstance(game, Scenario):
        told = game.told
        if noise_scale is None:
            return problem_of(told, sensor_model(game, layers), sigma, prior or game.prior)
    elif isinstance(game, Game):
        told = game
    else:
        raise TypeError(f"game must be a Game or a Scenario, got {game!r}")
    names = told.dynamics.state_names
    if noise_scale is None or np.shape(noise_scale) != (len(names),):
        got = "nothing" if noise_scale is None else repr(noise_scale)
        raise ValueError(
            f"noise_scale must say how large the noise on {', '.join(names)} is, relative to "
            f"sigma, got {got}; a scenario has it: problem(scenario, ...), or scenario.noise_scale"
        )
    model = SensorModel.of(layers, told.dynamics, noise_scale)
    return problem_of(
        told, model, sigma, prior or (game.prior if isinstance(game, Scenario) else FLAT)
    )


def _check_sigma(sigma: object) -> None:
    if isinstance(sigma, bool) or not isinstance(sigma, int | float | np.number):
        raise TypeError(f"sigma is one number of at least 0, got {sigma!r}")

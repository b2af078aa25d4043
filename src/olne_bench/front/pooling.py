"""Several motions of unlike cars, in this process: shared weights, and a prior of all drivers."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from olne_bench.estimators.posterior import Posterior
from olne_bench.estimators.protocol import Observation, Problem
from olne_bench.estimators.shared.pooled import Recorded, Together
from olne_bench.estimators.shared.population import fitted_population
from olne_bench.front.in_process import chosen_estimator
from olne_bench.games.model.weight_prior import WeightPrior

#: Rounds of ``population``: its samples come from the prior of the round before.
_ROUNDS = 3


def estimate_together(
    problems: Sequence[Problem],
    observations: Sequence[Observation],
    estimator: Any = "map",
    *,
    drivers: Sequence[Sequence[int]] | None = None,
    budget: float = 60.0,
    seed: int = 0,
) -> Together:
    """Estimate weights that several motions share.

    Games may differ in their players, roads, lengths, unknowns, sensors and noise.

    Args:
        problems: what is known of each motion.
        observations: what was seen of each.
        estimator: ``kkt_constrained``, ``map`` or ``posterior``, or an object with a method
            ``together``.
        drivers: for each motion, who its N players are: numbers from 0 on. Default: player i is
            driver i.
        budget: time that the search may take [s].
        seed: seed of the estimator's random numbers.

    Raises:
        ValueError: on motions that do not fit each other, or an estimator without ``together``.
    """
    chosen = chosen_estimator(estimator)
    if getattr(chosen.made, "together", None) is None:
        raise ValueError(
            f"estimator {chosen.entry.label!r} takes motions of unlike cars one by one; known are: "
            "kkt_constrained, map, posterior"
        )
    motions = _recorded(problems, observations, drivers)
    rng = np.random.default_rng(seed)
    found: Together = chosen.made.together(motions, rng=rng, budget=budget)
    return found


def population(
    problems: Sequence[Problem],
    observations: Sequence[Observation],
    *,
    budget: float = 60.0,
    seed: int = 0,
) -> WeightPrior:
    """A prior fitted to the drivers of many motions, each with weights of its own.

    The Dirichlet distribution of largest marginal likelihood, by samples of ``posterior``.

    Args:
        problems: what is known of each motion; all have the same weights.
        observations: what was seen of each.
        budget: time that the search on each motion may take [s].
        seed: seed of the random numbers.

    Raises:
        ValueError: on fewer than three drivers, or where no motion can be explained.
    """
    motions, prior = _recorded(problems, observations, None), problems[0].prior
    rng = np.random.default_rng(seed)
    for _ in range(_ROUNDS):
        samples = []
        for one in motions:
            told = replace(one.problem, prior=prior)
            found = Posterior().estimate(told, one.observation, rng=rng, budget=budget)
            if found.samples is not None:
                samples.append(np.maximum(found.samples, told.weight_floor))
        if not samples:
            raise ValueError("no motion has an equilibrium that explains it")
        prior = fitted_population(samples, prior)
    return prior


def _recorded(
    problems: Sequence[Problem],
    observations: Sequence[Observation],
    drivers: Sequence[Sequence[int]] | None,
) -> list[Recorded]:
    counts = len(problems), len(observations), len(problems if drivers is None else drivers)
    if not problems or len(set(counts)) > 1:
        raise ValueError(
            "give as many problems as observations and rows of drivers, and at least one; got "
            f"{counts[0]}, {counts[1]} and {counts[2]}"
        )
    rows = drivers or [range(one.game.num_players) for one in problems]
    return [
        Recorded(problem, seen, tuple(int(driver) for driver in row))
        for problem, seen, row in zip(problems, observations, rows, strict=True)
    ]

"""Rules of scenarios, as checks."""

from collections.abc import Callable
from typing import Any

import numpy as np

from olne_bench.bench.conformance import NonConformance, Weakness
from olne_bench.bench.conformance.differences import find_change
from olne_bench.envs.recordings.recording import NoEquilibriumError, record
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.plugins import takes_seed

_SEEDS = (0, 1, 2)


def _draws(plugin: Any) -> None:
    """It draws scenarios, with limits that are the same for every seed."""
    drawn = [_draw(plugin, seed) for seed in _SEEDS]
    for scenario in drawn:
        if scenario.limits is None:
            raise NonConformance("its scenario has no limits: a world builds its spaces from them")
        if scenario.limits != drawn[0].limits:
            raise NonConformance("limits change with the seed: give all draws the same")


def _determinism(plugin: Any) -> None:
    """The seed is its only source of randomness, and a family's seeds differ."""
    first = _draw(plugin, 0)
    np.random.seed(1)  # noqa: NPY002 (a scenario that uses it must not get away with it)
    change = find_change(first, _draw(plugin, 0), "scenario")
    if change is not None:
        raise NonConformance(f"two draws of seed 0 differ: {change}")
    if takes_seed(plugin) and find_change(first, _draw(plugin, 1), "scenario") is None:
        raise NonConformance("seeds 0 and 1 draw the same: a fixed scenario has draw(self)")


def _playable(plugin: Any) -> None:
    """It has an equilibrium, certified locally and globally so far, which its world plays."""
    seeds = _SEEDS if takes_seed(plugin) else (0,)
    refused = {}
    for seed in seeds:
        try:
            record(_draw(plugin, seed))
        except NoEquilibriumError as error:
            refused[seed] = str(error)
    reasons = "; ".join(f"seed {seed}: {reason}" for seed, reason in refused.items())
    if len(refused) == len(seeds):
        raise NonConformance(reasons)
    if refused:
        raise Weakness(f"{len(refused)} of {len(seeds)} draws cannot be used: {reasons}")


def _draw(plugin: Any, seed: int) -> Scenario:
    scenario = plugin.draw(seed) if takes_seed(plugin) else plugin.draw()
    if not isinstance(scenario, Scenario):
        raise NonConformance(
            f"draw() returned a {type(scenario).__name__}, expected an "
            "olne_bench.envs.scenarios.Scenario"
        )
    return scenario


#: Checks by name, in the order in which they run.
CHECKS: dict[str, Callable[[Any], None]] = {
    "draws scenarios": _draws,
    "determinism under a fixed seed": _determinism,
    "certified, locally and globally so far, and played by its world": _playable,
}

"""Random streams, seeded by the salt of a suite and the purpose of the numbers.

The noise of a trial can be drawn again, and subtracted, only by those who know the salt.
"""

import hashlib
import json

import numpy as np

from olne_bench.bench.plan.entries import ScenarioEntry

#: Name of ``envs.scenarios.changed`` and what it changes by default; its import takes a second.
_CHANGED, _USUAL = "changed", "highway"


def stream(salt: str, purpose: str, *key: str | int | float) -> int:
    """A seed of 63 bits; each purpose, and each key, has its own stream of numbers."""
    text = json.dumps([salt, purpose, *key])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") >> 1


def drawn_as(scenario: ScenarioEntry) -> tuple[str, str]:
    """Name and options, as JSON, that seed draws and noise.

    A changed scenario has those of the scenario without the change, so that the two are compared
    on the same draws.
    """
    name, options = scenario.name, scenario.options
    if name == _CHANGED:
        name, options = options.get("of", _USUAL), options.get("options", {})
    return name, json.dumps(options, sort_keys=True)


def noise_seed(scenario: ScenarioEntry, sigma: float, seed: int, salt: str) -> int:
    """Seed of a trial's noise, the same for every sensor and estimator."""
    return stream(salt, "noise", *drawn_as(scenario), round(sigma * 1e9), seed)


def generator_of(values: np.ndarray) -> np.random.Generator:
    """Random numbers that depend on an array alone: who scores it again draws the same."""
    digest = hashlib.sha256(np.ascontiguousarray(values).tobytes()).digest()
    return np.random.default_rng(int.from_bytes(digest[:8], "little"))

"""OLNE Bench: a benchmark for inverse dynamic games.

    import olne_bench as ob

    scenario = ob.scenario("merge", seed=0)
    problem, seen = ob.observe(scenario, sensor="partial", sigma=0.2)
    estimate = ob.estimate(problem, seen, "map")

Names are imported when they are first used, as the libraries behind them take seconds.
"""

import sys
from importlib import import_module
from typing import Any

#: Public names, and the modules that define them. ``__init__.pyi`` says the same to type checkers.
_HOMES = {
    "Estimate": "estimators.protocol",
    "Game": "games.model.game",
    "NoEquilibriumError": "envs.scenarios.scenario",
    "NoRootError": "front.games",
    "Observation": "estimators.protocol",
    "Player": "games.model.game",
    "Problem": "estimators.protocol",
    "Scenario": "envs.scenarios.scenario",
    "Unknown": "games.model.unknowns",
    "behaviours": "front.behaving",
    "certify": "games.solve.olne",
    "compare": "front.comparing",
    "estimate": "front.estimating",
    "estimate_together": "front.pooling",
    "fisher_information": "front.games",
    "observe": "front.observing",
    "parallel_env": "front.worlds",
    "population": "front.pooling",
    "predict": "front.predicting",
    "problem": "front.observing",
    "read": "front.studies",
    "run": "front.studies",
    "scenario": "front.drawing",
    "scenarios": "catalogue",
    "sensors": "catalogue",
    "solve_olne": "front.games",
}
#: Public modules under shorter names. ``estimators`` can be called, too.
_MODULES = {
    "constraints": "games.model.constraints",
    "costs": "games.model.costs",
    "dynamics": "games.model.dynamics",
    "estimators": "estimators",
    "metrics": "bench.judge.metrics.formulas",
    "views": "games.model.observation",
}

__all__ = ["__version__", *sorted({*_HOMES, *_MODULES})]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version("olne-bench")
    elif name in _HOMES:
        found = getattr(import_module(f"olne_bench.{_HOMES[name]}"), name)
    elif name in _MODULES:
        found = import_module(f"olne_bench.{_MODULES[name]}")
    else:
        raise AttributeError(f"module 'olne_bench' has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


# gymnasium.make("olne_bench:olne/...") imports this package and expects the id to be registered.
# Without Gymnasium, the slow import is skipped.
if "gymnasium" in sys.modules:
    import olne_bench.envs  # noqa: F401

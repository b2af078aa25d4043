"""Where estimators that are not of this package may rank: on truths that seeds draw.

Published weights are constants that anyone can look up, and return for any observation.
"""

from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry
from olne_bench.envs.scenarios.true_weights import DIRICHLET, MODERATE, PUBLISHED
from olne_bench.errors import UserError
from olne_bench.plugins import ESTIMATOR, SCENARIO, is_built_in, make


def has_drawn_truths(scenario: ScenarioEntry) -> bool:
    """Whether each seed draws the true weights of a scenario; if not, they are constants.

    A family of a plugin is taken at its word. A built-in one may draw all but the weights.
    """
    if not scenario.family:
        return False
    if not is_built_in(SCENARIO, scenario.name):
        return True
    try:
        plugin = make(SCENARIO, scenario.name, scenario.options)
    except UserError:  # stored by another version, which had other options
        return False
    return getattr(plugin, "weights", None) != PUBLISHED


def drawn_twin(scenario: ScenarioEntry) -> ScenarioEntry | None:
    """A built-in scenario of fixed truths with weights that each seed draws; None if it has none.

    All else is as it was: players, roads and trajectories.
    """
    if not is_built_in(SCENARIO, scenario.name):
        return None
    for kind in (DIRICHLET, MODERATE):
        options = scenario.options | {"weights": kind}
        try:
            plugin = make(SCENARIO, scenario.name, options)
        except UserError:  # it does not draw weights of this kind
            continue
        if getattr(plugin, "weights", None) == kind:
            label = f"{scenario.label}, drawn weights"
            return scenario.model_copy(update={"options": options, "label": label, "family": True})
    return None


def is_foreign(estimator: EstimatorEntry) -> bool:
    """Whether an estimator is a plugin of a file or of another package."""
    return not is_built_in(ESTIMATOR, estimator.name)

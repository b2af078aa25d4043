"""Where estimators that are not of this package may rank: on truths that seeds draw.

Published weights are constants that anyone can look up, and return for any observation.
"""

from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry
from olne_bench.envs.true_weights import PUBLISHED
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


def is_foreign(estimator: EstimatorEntry) -> bool:
    """Whether an estimator is a plugin of a file or of another package."""
    return not is_built_in(ESTIMATOR, estimator.name)

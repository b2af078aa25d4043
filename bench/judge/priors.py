"""Whether the prior of an estimator gives the truth of a scenario any mass."""

from olne_bench import plugins
from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.estimators.protocol import Problem
from olne_bench.estimators.shared.prior_mass import LEAST_MASS, excluded_weight

#: Estimators with a Dirichlet prior, whose parameter is their ``alpha``.
WITH_PRIOR = ("map", "posterior")


def alpha_of(estimator: EstimatorEntry) -> float:
    """The parameter of its prior, of which 1 or less excludes nothing; zero if it has none."""
    if estimator.name not in WITH_PRIOR:
        return 0.0
    return float(plugins.make(plugins.ESTIMATOR, estimator.name, estimator.parameters).alpha)


def exclusion(estimator: EstimatorEntry, scenario: Scenario) -> str:
    """Why an estimator can never find the true weights; empty if it can, or has no prior."""
    alpha = alpha_of(estimator)
    found = excluded_weight(scenario.weights, alpha, Problem.weight_floor)
    if found is None:
        return ""
    player, weight = found
    return (
        f"its prior (alpha = {alpha:g}) gives the truth no mass: weight "
        f"{scenario.game.weight_names[weight]!r} of player {player} is "
        f"{scenario.weights[found]:.3g}, and the prior's probability of one as extreme is below "
        f"{LEAST_MASS:g}"
    )

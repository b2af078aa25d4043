"""Whether the prior of an estimator gives the truth of a scenario any mass."""

from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.bench.plan.kinds import Rules
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.estimators.protocol import Problem
from olne_bench.games.model.weight_prior import LEAST_MASS, WeightPrior

#: Built-in estimators that use the prior of weights.
WITH_PRIOR = {"behaving", "imperfect", "map", "neural_posterior", "particle", "posterior", "robust"}
WITH_PRIOR |= {"ukf"}

#: Those that may have another one.
_WITH_ALPHA = ("imperfect", "map", "posterior")


def prior_told(scenario: Scenario, rules: Rules) -> WeightPrior:
    """The prior that estimators are told of, by the rules of a study."""
    return scenario.prior if rules.prior is None else WeightPrior((rules.prior,))


def prior_used(estimator: EstimatorEntry, told: WeightPrior) -> WeightPrior | None:
    """The prior that an estimator uses: the told one, or one that its parameters name instead."""
    if estimator.name not in WITH_PRIOR or estimator.parameters.get("of") == "kkt_constrained":
        return None
    alpha = estimator.parameters.get("alpha") if estimator.name in _WITH_ALPHA else None
    return told if alpha is None else WeightPrior((float(alpha),))


def exclusion(estimator: EstimatorEntry, scenario: Scenario, told: WeightPrior) -> str:
    """Why an estimator can never find the true weights; empty if it can, or has no prior."""
    prior = prior_used(estimator, told)
    found = prior.excluded(scenario.weights, Problem.weight_floor) if prior else None
    if found is None:
        return ""
    player, weight = found
    return (
        f"its prior {prior!r} gives the truth no mass: weight "
        f"{scenario.game.weight_names[weight]!r} of player {player} is "
        f"{scenario.weights[found]:.3g}, and the prior's probability of one as extreme is below "
        f"{LEAST_MASS:g}"
    )

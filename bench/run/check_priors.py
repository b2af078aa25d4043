"""Check before a run that no estimator has a prior that excludes the truth of a scenario."""

from pathlib import Path

import msgspec

from olne_bench import plugins
from olne_bench.bench.judge.priors import alpha_of, exclusion
from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.run.ask_child import asked
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.scenarios import get_scenario
from olne_bench.errors import UserError


class Excluded(msgspec.Struct):
    """Why a prior excludes a truth; empty if it does not."""

    why: str


def check_priors(suite: Suite, hidden: Path | None = None) -> None:
    """Refuse priors that give the truth of a fixed scenario no mass.

    Truths that seeds draw are known when they are judged: such a trial is ``invalid``.

    Args:
        suite: suite to be run.
        hidden: folder that foreign code cannot read.

    Raises:
        UserError: with a message that names the first such pair, the weight, and what to do.
    """
    for scenario, estimator in suite.pairs():
        if scenario.family or alpha_of(estimator) <= 1:
            continue
        if plugins.is_built_in(plugins.SCENARIO, scenario.name):
            why = excluded(scenario, estimator).why
        else:
            about, names = (scenario, estimator), (scenario.name, estimator.name)
            found = asked(excluded, *about, kind=Excluded, plugins=names, hidden=hidden)
            why = found.why if found else ""
        if why:
            raise UserError(
                f"suite {suite.name!r}: estimator {estimator.label!r} cannot be run in scenario "
                f"{scenario.label!r}: {why}; choose an alpha nearer to 1, or limit the estimator "
                "to other scenarios (key 'scenarios')"
            )


def excluded(scenario: ScenarioEntry, estimator: EstimatorEntry) -> Excluded:
    """Why the prior of an estimator excludes the truth of a scenario, found in this process."""
    try:
        drawn = get_scenario(scenario.name, **scenario.options)
    except NoEquilibriumError:
        return Excluded("")
    return Excluded(exclusion(estimator, drawn))

"""Check before a run that no estimator has a prior that excludes the truth of a scenario."""

from pathlib import Path

import msgspec

from olne_bench import plugins
from olne_bench.bench.judge.priors import WITH_PRIOR, exclusion
from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.process.child import Child, ChildError, RaisedError, StartError
from olne_bench.bench.run.describing import LOAD_LIMIT, LOAD_MEMORY
from olne_bench.envs.recording import NoEquilibriumError
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
        if scenario.family or estimator.name not in WITH_PRIOR:
            continue
        if plugins.is_built_in(plugins.SCENARIO, scenario.name):
            why = excluded(scenario, estimator).why
        else:
            why = _asked(scenario, estimator, hidden)
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


def _asked(scenario: ScenarioEntry, estimator: EstimatorEntry, hidden: Path | None) -> str:
    """The answer of a child process, which foreign code may take down."""
    child = Child(restricted=True, memory=LOAD_MEMORY, hidden=hidden)
    try:
        found: Excluded = child.call(
            excluded, scenario, estimator, kind=Excluded, seconds=LOAD_LIMIT
        )
    except StartError:
        raise
    except (ChildError, RaisedError, UserError):
        return ""  # the scenario's draw fails, which its trials will show
    finally:
        child.stop()
    return found.why

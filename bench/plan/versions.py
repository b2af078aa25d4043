"""Versions of what a trial's result depends on: estimator, scenario, scoring."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import olne_bench
from olne_bench.bench.plan.fingerprint import fingerprint
from olne_bench.bench.plan.suite import EstimatorEntry, ScenarioEntry
from olne_bench.estimators.registry import estimator_source, is_file_reference

_PACKAGES = Path(str(olne_bench.__file__)).parents[1]
_GAMES, _ENVS, _ESTIMATORS = (
    {f"olne_bench.{name}": _PACKAGES} for name in ("games", "envs", "estimators")
)
_SCORING = (
    "judge.differences",
    "judge.estimate_check",
    "judge.metrics.cosine_error",
    "judge.metrics.covers_truth",
    "judge.metrics.declaration",
    "judge.metrics.formulas",
    "judge.metrics.held_out_error",
    "judge.metrics.judged",
    "judge.metrics.position_error",
    "judge.metrics.reconstruction_error",
    "judge.metrics.scoring",
    "judge.nearby_starts",
    "judge.observe",
    "judge.referee",
    "judge.truth",
    "text",
)


@dataclass(frozen=True)
class Versions:
    """Fingerprints; rows of a trial with the same three are the same measurement.

    Attributes:
        estimator: of the estimator's code, with what it imports from its own package or folder
            and from this benchmark. Its parameters are part of a trial's key anyway.
        scenario: of the scenario's code, and of what plays it.
        scoring: of what turns an estimate into a row.
    """

    estimator: str = ""
    scenario: str = ""
    scoring: str = ""


def versions(scenario: ScenarioEntry, estimator: EstimatorEntry) -> Versions:
    """The versions as this process's code has them.

    Raises:
        EstimatorError: where the estimator cannot be loaded.
    """
    return Versions(
        estimator=_estimator_version(estimator.name),
        scenario=_scenario_version(scenario.name),
        scoring=_scoring_version(),
    )


def explain_difference(
    scenario: ScenarioEntry, estimator: EstimatorEntry, expected: Versions
) -> str | None:
    """One line on how this process's code differs from what is expected; None where it does not."""
    actual = versions(scenario, estimator)
    for what, old, new in (
        (f"estimator {estimator.label!r}", expected.estimator, actual.estimator),
        (f"scenario {scenario.label!r}", expected.scenario, actual.scenario),
        ("the scoring", expected.scoring, actual.scoring),
    ):
        if old != new:
            return f"the code of {what} is {new} in the worker and {old} where the run was started"
    return None


@lru_cache(maxsize=256)
def _estimator_version(reference: str) -> str:
    module, path = estimator_source(reference)
    roots = _GAMES | _ESTIMATORS
    if is_file_reference(reference):
        return fingerprint({path.stem: path}, roots, own=path.parent)
    top = module.partition(".")[0]
    depth = module.count(".") + (path.name == "__init__.py")
    return fingerprint({module: path}, {top: path.parents[depth]} | roots, own=None)


@lru_cache(maxsize=256)
def _scenario_version(name: str) -> str:
    starts = _modules("olne_bench.envs", (f"scenarios.{name}", "recording"))
    return fingerprint(starts, _ENVS | _GAMES, own=None)


@lru_cache(maxsize=1)
def _scoring_version() -> str:
    return fingerprint(_modules("olne_bench.bench", _SCORING), _GAMES, own=None)


def _modules(package: str, names: tuple[str, ...]) -> dict[str, Path]:
    """Names and files of modules of a package of ours."""
    full = [f"{package}.{name}" for name in names]
    return {name: _PACKAGES.joinpath(*name.split(".")).with_suffix(".py") for name in full}

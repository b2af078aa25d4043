"""Versions of what a trial's result depends on: estimator, scenario, scoring."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import envs
import estimators
import games
from bench.source import fingerprint
from bench.suite import EstimatorEntry, ScenarioEntry
from estimators.registry import estimator_source, is_file_reference

_HERE = Path(__file__).parent
_GAMES = Path(str(games.__file__)).parents[1]
_ENVS = Path(str(envs.__file__)).parents[1]
_ESTIMATORS = Path(str(estimators.__file__)).parents[1]
_SCORING = (
    "changes",
    "checked_estimate",
    "evaluate",
    "metrics",
    "neighbours",
    "sensor",
    "text",
    "truth",
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
    roots = {"games": _GAMES, "estimators": _ESTIMATORS}
    if is_file_reference(reference):
        return fingerprint({path.stem: path}, roots, own=path.parent)
    top = module.partition(".")[0]
    depth = module.count(".") + (path.name == "__init__.py")
    return fingerprint({module: path}, {top: path.parents[depth]} | roots, own=None)


@lru_cache(maxsize=256)
def _scenario_version(name: str) -> str:
    starts = {
        f"envs.scenarios.{name}": _ENVS / "envs" / "scenarios" / f"{name}.py",
        "envs.recording": _ENVS / "envs" / "recording.py",
    }
    return fingerprint(starts, {"envs": _ENVS, "games": _GAMES}, own=None)


@lru_cache(maxsize=1)
def _scoring_version() -> str:
    starts = {f"bench.{name}": _HERE / f"{name}.py" for name in _SCORING}
    return fingerprint(starts, {"games": _GAMES}, own=None)

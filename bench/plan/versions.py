"""Versions of what a trial's result depends on: estimator, scenario, scoring."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import olne_bench
from olne_bench.bench.plan.fingerprint import fingerprint
from olne_bench.bench.plan.suite import EstimatorEntry, ScenarioEntry
from olne_bench.plugins import ESTIMATOR, SCENARIO, Kind, is_file, source

_PACKAGES = Path(str(olne_bench.__file__)).parents[1]
_GAMES, _ENVS, _ESTIMATORS = (
    {f"olne_bench.{name}": _PACKAGES} for name in ("games", "envs", "estimators")
)
_SCORING = (
    "judge.differences",
    "judge.estimate_check",
    "judge.metrics",
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
        PluginError: where the scenario or estimator cannot be found.
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
    return fingerprint(*_code(ESTIMATOR, reference, _GAMES | _ESTIMATORS))


@lru_cache(maxsize=256)
def _scenario_version(name: str) -> str:
    starts, roots, own = _code(SCENARIO, name, _ENVS | _GAMES)
    return fingerprint(starts | _modules("olne_bench.envs", ("recording",)), roots, own)


def _code(
    kind: Kind, reference: str, roots: dict[str, Path]
) -> tuple[dict[str, Path], dict[str, Path], Path | None]:
    """Where a plugin's code begins, what it may lead to, and the folder that is its own."""
    module, path = source(kind, reference)
    if is_file(reference):
        return {path.stem: path}, roots, path.parent
    top = module.partition(".")[0]
    depth = module.count(".") + (path.name == "__init__.py")
    return {module: path}, {top: path.parents[depth]} | roots, None


@lru_cache(maxsize=1)
def _scoring_version() -> str:
    return fingerprint(_modules("olne_bench.bench", _SCORING), _GAMES, own=None)


def _modules(package: str, names: tuple[str, ...]) -> dict[str, Path]:
    """Names and files of modules of a package of ours."""
    full = [f"{package}.{name}" for name in names]
    return {name: _PACKAGES.joinpath(*name.split(".")).with_suffix(".py") for name in full}

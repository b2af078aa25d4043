"""Versions of what a trial's result depends on."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import olne_bench
from olne_bench.bench.plan.entries import EstimatorEntry, MetricEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.fingerprint import LENGTH, data_beside, fingerprint, modules_used
from olne_bench.games.native import backend
from olne_bench.plugins import ESTIMATOR, METRIC, SCENARIO, SENSOR, Kind, is_file, source

_PACKAGES = Path(str(olne_bench.__file__)).parents[1]
_GAMES, _ENVS, _ESTIMATORS, _BENCH = (
    {f"olne_bench.{name}": _PACKAGES} for name in ("games", "envs", "estimators", "bench")
)
_COMMON = {
    ESTIMATOR: _GAMES | _ESTIMATORS,
    SCENARIO: _ENVS | _GAMES,
    SENSOR: _ENVS | _GAMES,
    METRIC: _GAMES | _BENCH,
}
#: Modules that play a scenario, and modules that let a sensor see it.
_AT_WORK = {SCENARIO: ("recording",), SENSOR: ("wrappers",)}
_SCORING = (
    "judge.estimate_check",
    "judge.metrics.formulas",
    "judge.metrics.judged",
    "judge.metrics.scoring",
    "judge.nearby_starts",
    "judge.observe",
    "judge.raw_estimate",
    "judge.referee",
    "judge.streams",
    "judge.truth",
    "run.player",
    "text",
)
#: What hands out samples one by one, and scores predictions.
_FOLLOWING = ("judge.online", "judge.predictions", "run.stream_player")
#: What lets an ego drive, beside what it imports from games, environments and estimators.
_DRIVING = (
    "judge.beliefs",
    "judge.driving",
    "judge.estimate_check",
    "judge.raw_estimate",
    "judge.streams",
    "run.stream_player",
)
#: Another version of one of these may round differently, or draw other numbers.
_LIBRARIES = ("numpy", "scipy", "casadi", "pettingzoo", "gymnasium", "highway-env")


@dataclass(frozen=True)
class Versions:
    """Fingerprints of code; rows of a trial with equal ones are the same measurement.

    Attributes:
        estimator: the estimator, with what it imports from its own package or folder and from this
            benchmark. Its parameters are part of a trial's key.
        scenario: the scenario and the code that plays it.
        sensor: the sensor's layers.
        scoring: the code that turns an estimate into a row, metrics and their parameters included.
        environment: versions of libraries, and the backend that solves games.
    """

    estimator: str = ""
    scenario: str = ""
    sensor: str = ""
    scoring: str = ""
    environment: str = ""


#: Columns of a row, and their SQL types.
VERSION_COLUMNS = {f"{f.name}_version": "TEXT" for f in fields(Versions)}


def versions(
    scenario: ScenarioEntry,
    sensor: SensorEntry,
    estimator: EstimatorEntry,
    metrics: tuple[MetricEntry, ...],
) -> Versions:
    """The versions of the code on this machine; foreign code is read, not run.

    Raises:
        UserError: where the code of one of them is not found.
    """
    named = tuple((m.name, json.dumps(m.parameters, sort_keys=True)) for m in metrics)
    return Versions(
        estimator=_version(ESTIMATOR, estimator.name),
        scenario=_version(SCENARIO, scenario.name),
        sensor=_digest(_version(SENSOR, layer.name) for layer in sensor.layers),
        scoring=_scoring(named),
        environment=environment_version(environment()),
    )


def environment_version(libraries: Mapping[str, str]) -> str:
    """``Versions.environment`` of these versions of libraries, as ``environment`` lists them."""
    return _digest(f"{name} {value}" for name, value in libraries.items())


def with_following(code: Versions) -> Versions:
    """Versions of a trial for a motion, whose row depends on more of our code."""
    return replace(code, scoring=_digest([code.scoring, _following()]))


def code_of_drive(reference: str) -> str:
    """Fingerprint of what a drive depends on.

    Args:
        reference: names the estimator; empty for none.

    Raises:
        UserError: if its code is not found.
    """
    estimator = _version(ESTIMATOR, reference) if reference else ""
    modules = _modules("olne_bench.bench", _DRIVING)
    own = fingerprint(modules, _GAMES | _ENVS | _ESTIMATORS, own=None)
    return _digest([estimator, own, *(f"{name} {value}" for name, value in environment().items())])


def files_of(kind: Kind, reference: str) -> list[Path]:
    """Files below a plugin's folder that its version covers; its own file comes first.

    Args:
        kind: kind of the plugin.
        reference: names a file.

    Raises:
        UserError: where there is no such file.
    """
    path = source(kind, reference)[1]
    found = modules_used({path.stem: path}, _COMMON[kind], own=path.parent).values()
    own = [path, *sorted(f for f in found if f != path and f.is_relative_to(path.parent))]
    return [f for module in own for f in (module, *data_beside(module))]


@lru_cache(maxsize=1)
def environment() -> Mapping[str, str]:
    """Versions of libraries and the backend, as ``Versions.environment`` covers them."""
    found = {name: _library(name) for name in _LIBRARIES}
    return found | {"backend": backend()}


def _library(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


@lru_cache(maxsize=256)
def _version(kind: Kind, reference: str) -> str:
    module, path = source(kind, reference)
    around = _modules("olne_bench.envs", _AT_WORK.get(kind, ()))
    if is_file(reference):
        return fingerprint({path.stem: path} | around, _COMMON[kind], own=path.parent)
    top = module.partition(".")[0]
    depth = module.count(".") + (path.name == "__init__.py")
    # This package has its roots above; another package counts as a whole.
    folder = {} if top == "olne_bench" else {top: path.parents[depth]}
    return fingerprint({module: path} | around, folder | _COMMON[kind], own=None)


@lru_cache(maxsize=64)
def _scoring(metrics: tuple[tuple[str, str], ...]) -> str:
    own = fingerprint(_modules("olne_bench.bench", _SCORING), _GAMES, own=None)
    return _digest([own, *(f"{_version(METRIC, name)} {given}" for name, given in metrics)])


@lru_cache(maxsize=1)
def _following() -> str:
    modules = _modules("olne_bench.bench", _FOLLOWING)
    return fingerprint(modules, _GAMES | _ENVS | _ESTIMATORS, own=None)


def _digest(texts: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for text in texts:
        digest.update(f"{text}\n".encode())
    return digest.hexdigest()[:LENGTH]


def _modules(package: str, names: tuple[str, ...]) -> dict[str, Path]:
    """Names and files of modules of a package of ours."""
    full = [f"{package}.{name}" for name in names]
    return {name: _PACKAGES.joinpath(*name.split(".")).with_suffix(".py") for name in full}

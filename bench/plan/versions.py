"""Versions of what a trial's result depends on."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import olne_bench
from olne_bench.bench.plan.entries import EstimatorEntry, MetricEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.plan.fingerprint import LENGTH, data_beside, fingerprint, modules_used
from olne_bench.bench.plan.kinds import StudyKind
from olne_bench.bench.process.arithmetic import arithmetic
from olne_bench.games.compiled.compiler import backend
from olne_bench.plugins import ESTIMATOR, METRIC, SCENARIO, SENSOR, Kind, is_file, source

_PACKAGES = Path(str(olne_bench.__file__)).parents[1]
#: All modules of this package count. Imports point one way, so an estimator's version covers no
#: scenario, and no version covers a report or a command.
_OURS = {"olne_bench": _PACKAGES}
#: Modules that play a scenario, and modules that let a sensor see it.
_AT_WORK = {SCENARIO: ("envs.recordings.recording",), SENSOR: ("envs.worlds.wrappers",)}
#: What makes a row of each kind of study, with all that it imports.
_PLAYERS = ("bench.run.player", "bench.run.player_process")
_JUDGES: dict[StudyKind, tuple[str, ...]] = {
    "trials": ("bench.judge.trials", *_PLAYERS, "bench.run.metric_process"),
    "streams": ("bench.judge.streams", *_PLAYERS),
    "drives": ("bench.judge.drives", *_PLAYERS),
}
#: Another version of one of these may round differently, or draw other numbers.
_LIBRARIES = (
    *("numpy", "scipy", "casadi", "pettingzoo", "gymnasium", "highway-env", "scoringrules"),
)


@dataclass(frozen=True)
class Versions:
    """Fingerprints of code; rows of a trial with equal ones are the same measurement."""

    estimator: str = ""  # with what it imports of its own package or folder, and of this benchmark
    scenario: str = ""  # with the code that plays it
    sensor: str = ""
    # the code that turns an estimate into a row, metrics and their parameters included
    scoring: str = ""
    # versions of libraries, the backend that solves games, and the arithmetic
    environment: str = ""


#: Columns of a row, and their SQL types.
VERSION_COLUMNS = {f"{f.name}_version": "TEXT" for f in fields(Versions)}


def versions(
    scenario: ScenarioEntry,
    sensor: SensorEntry,
    estimator: EstimatorEntry,
    metrics: tuple[MetricEntry, ...],
    kind: StudyKind = "trials",
) -> Versions:
    """The versions of the code on this machine; foreign code is read, not run."""
    named = tuple((m.name, json.dumps(m.parameters, sort_keys=True)) for m in metrics)
    worlds = ("", "")  # those of drives are a part of what judges them
    if kind != "drives":
        seen = _digest(_version(SENSOR, layer.name) for layer in sensor.layers)
        worlds = (_version(SCENARIO, scenario.name), seen)
    return Versions(
        estimator=_version(ESTIMATOR, estimator.name),
        scenario=worlds[0],
        sensor=worlds[1],
        scoring=_scoring(named, kind),
        environment=environment_version(environment()),
    )


def environment_version(libraries: Mapping[str, str]) -> str:
    """``Versions.environment`` of these versions of libraries, as ``environment`` lists them."""
    return _digest(f"{name} {value}" for name, value in libraries.items())


def files_of(kind: Kind, reference: str) -> list[Path]:
    """Files below the folder of a plugin's file that its version covers; its own comes first."""
    path = source(kind, reference)[1]
    found = modules_used({path.stem: path}, _OURS, own=path.parent).values()
    own = [path, *sorted(f for f in found if f != path and f.is_relative_to(path.parent))]
    return [f for module in own for f in (module, *data_beside(module))]


@lru_cache(maxsize=1)
def environment() -> Mapping[str, str]:
    """What ``Versions.environment`` covers: whatever rounds, or draws numbers, beside our code."""
    found = {name: _library(name) for name in _LIBRARIES}
    return found | {"backend": backend(), "arithmetic": arithmetic()}


def _library(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


@lru_cache(maxsize=256)
def _version(kind: Kind, reference: str) -> str:
    module, path = source(kind, reference)
    around = _modules(_AT_WORK.get(kind, ()))
    if is_file(reference):
        return fingerprint({path.stem: path} | around, _OURS, own=path.parent)
    top = module.partition(".")[0]
    depth = module.count(".") + (path.name == "__init__.py")
    # This package has its roots above; another package counts as a whole.
    folder = {} if top == "olne_bench" else {top: path.parents[depth]}
    return fingerprint({module: path} | around, folder | _OURS, own=None)


@lru_cache(maxsize=64)
def _scoring(metrics: tuple[tuple[str, str], ...], kind: StudyKind) -> str:
    of_each = (f"{_version(METRIC, name)} {given}" for name, given in metrics)
    return _digest([_ours(_JUDGES[kind]), *of_each])


@lru_cache(maxsize=4)
def _ours(names: tuple[str, ...]) -> str:
    return fingerprint(_modules(names), _OURS, own=None)


def _digest(texts: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for text in texts:
        digest.update(f"{text}\n".encode())
    return digest.hexdigest()[:LENGTH]


def _modules(names: tuple[str, ...]) -> dict[str, Path]:
    """Full names and files of modules of this package."""
    full = [f"olne_bench.{name}" for name in names]
    return {name: _PACKAGES.joinpath(*name.split(".")).with_suffix(".py") for name in full}

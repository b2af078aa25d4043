"""The folder of a submission: its manifest, and the files that the manifest lists."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from olne_bench.bench.plan.entries import EstimatorEntry
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import foreign_worlds
from olne_bench.bench.plan.values import cut, shown
from olne_bench.bench.run.provenance import Provenance, provenance_json
from olne_bench.bench.submission.files import (
    MOST_BYTES,
    MOST_FILES,
    check_folder,
    check_place,
    digest,
    read_file,
)
from olne_bench.errors import UserError
from olne_bench.plugins import ESTIMATOR, METRIC, is_built_in, names

MANIFEST = "submission.json"
ROWS = "trials.parquet"
LEADERBOARD = "leaderboard.csv"
LEADERBOARD_TEXT = "leaderboard.md"
#: Folder with the sources of plugins, one folder per plugin.
PLUGINS = "plugins"
#: Largest number of runs that the rows come from: each time that a run went on counts.
MOST_RUNS = 1000

_FORMAT = 1
_NAME = re.compile(r"[a-z0-9][a-z0-9_.-]{0,59}")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_PROVENANCE = TypeAdapter(Provenance)


@dataclass(frozen=True)
class Submission:
    """A run as it was submitted."""

    folder: Path
    name: str
    # provenance of its rows; suites name plugins by their path in the folder
    runs: tuple[Provenance, ...]
    files: Mapping[str, str]  # SHA-256 of every other file, by its path in the folder

    def suites(self, home: Path) -> list[Suite]:
        """Suites of the runs, with plugins located in the folder ``home``."""
        return [self._at(home, read_suite_json(run.suite)) for run in self.runs]

    def _at(self, home: Path, suite: Suite) -> Suite:
        refuse_foreign_worlds(suite)
        check_labels(suite)
        entries = [
            entry.model_copy(update={"name": self._located(home, entry)})
            for entry in suite.estimators
        ]
        return suite.model_copy(update={"estimators": tuple(entries)})

    def _located(self, home: Path, entry: EstimatorEntry) -> str:
        place, suffix, class_name = entry.name.rpartition(".py")
        if not suffix and not is_built_in(ESTIMATOR, entry.name):
            raise UserError(
                f"{self.folder}: estimator {shown(entry.label)} is {shown(entry.name)}, which is "
                "neither of this package nor a file of the submission"
            )
        if suffix and (
            place + suffix not in self.files or not entry.name.startswith(f"{PLUGINS}/")
        ):
            raise UserError(
                f"{self.folder}: the plugin {cut(place)}.py of estimator {shown(entry.label)} "
                "is missing"
            )
        inside = place.removeprefix(f"{PLUGINS}/")
        return f"{home / inside}{suffix}{class_name}" if suffix else entry.name


def refuse_foreign_worlds(suite: Suite) -> None:
    """Refuse a suite with other plugins than estimators."""
    foreign = [w for s in suite.scenarios for e in suite.sensors for w in foreign_worlds(s, e)]
    foreign += [m.name for m in suite.metrics if not is_built_in(METRIC, m.name)]
    if foreign:
        raise UserError(
            f"{cut(foreign[0])} is a plugin that others' estimators are not run with: a submission "
            "brings estimators; leave it out of the run, or propose it for the package"
        )


def check_labels(suite: Suite) -> None:
    """Refuse the name of a built-in estimator as the label of anything else (UserError)."""
    known = {name for name in names(ESTIMATOR) if is_built_in(ESTIMATOR, name)}
    for entry in suite.estimators:
        if entry.label in known and (entry.name != entry.label or entry.parameters):
            raise UserError(
                f"an estimator is labelled {entry.label!r} and is not that estimator as it comes "
                "with this package: give it another label"
            )


def check_name(name: str, what: str) -> None:
    """Refuse what cannot be the name of a submission."""
    if not _NAME.fullmatch(name):
        raise UserError(
            f"{what} {shown(name)}: a name has 1 to 60 of a-z, 0-9, '_', '-' and '.', and starts "
            "with a letter or digit"
        )


def manifest_text(name: str, runs: list[Provenance], files: Mapping[str, str]) -> str:
    """The manifest of a submission, as JSON."""
    data = {
        "format": _FORMAT,
        "name": name,
        "files": dict(sorted(files.items())),
        "runs": [json.loads(provenance_json(run)) for run in runs],
    }
    return json.dumps(data, indent=1, ensure_ascii=False) + "\n"


def read_submission(folder: Path) -> Submission:
    """Read a submission, and check its files against its manifest (UserError)."""
    path = folder / MANIFEST
    if not path.is_symlink() and not path.exists():
        raise UserError(f"no submission in {folder}: it has no {MANIFEST}")
    data = read_file(folder, MANIFEST, MOST_BYTES // 2)
    try:
        found = _parsed(folder, data)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        said = "it is nested too deep" if isinstance(error, RecursionError) else repr(error)
        raise UserError(f"{path} is not the manifest of a submission: {cut(said)}") from error
    if not found.runs or ROWS not in found.files:
        raise UserError(f"{path} names no {ROWS if found.runs else 'run'}")
    check_folder(folder, found.files, MANIFEST)
    for place, expected in found.files.items():
        if digest(read_file(folder, place)) != expected:
            raise UserError(f"{folder}: {place} was changed after it was submitted")
    return found


def _parsed(folder: Path, data: bytes) -> Submission:
    stored = _strict_json(data.decode("utf-8"))
    if not isinstance(stored, dict):
        raise TypeError("it is not an object")
    if stored["format"] != _FORMAT:
        raise UserError(
            f"{folder / MANIFEST} has the format {shown(stored['format'])}, this version of "
            f"olne-bench knows {_FORMAT}"
        )
    if not isinstance(stored["runs"], list) or len(stored["runs"]) > MOST_RUNS:
        raise ValueError(f"runs is not a list of at most {MOST_RUNS}")
    runs = tuple(_run(run) for run in stored["runs"])
    name, files = stored["name"], stored["files"]
    if not isinstance(name, str) or not isinstance(files, dict) or len(files) > MOST_FILES:
        raise ValueError(f"name is not a text, or files is not a table of at most {MOST_FILES}")
    check_name(name, f"{folder / MANIFEST}: name")
    for place, value in files.items():
        check_place(place, folder)
        if not isinstance(value, str) or not _DIGEST.fullmatch(value):
            raise ValueError(f"the SHA-256 of {shown(place)} is {shown(value)}")
    return Submission(folder, name, runs, files)


def _run(stored: Any) -> Provenance:
    run = _PROVENANCE.validate_json(json.dumps(stored), strict=True)
    _strict_json(run.suite, constants=True)
    if run.seeds < 1:
        raise ValueError(f"a run has {run.seeds} seeds")
    return run


def _strict_json(text: str, *, constants: bool = False) -> Any:
    """JSON whose keys are different; with ``constants``, numbers may be infinite."""
    number = None if constants else _refuse_constant
    return json.loads(text, object_pairs_hook=_distinct, parse_constant=number)


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key stands there twice")
    return found


def _refuse_constant(text: str) -> Any:
    raise ValueError(f"{text} is not a number")

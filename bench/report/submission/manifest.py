"""The folder of a submission: its manifest, and the files that the manifest lists."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.run.provenance import Provenance, provenance_json, read_provenance
from olne_bench.errors import UserError

MANIFEST = "submission.json"
ROWS = "trials.parquet"
LEADERBOARD = "leaderboard.csv"
#: Folder with the sources of plugins, one folder per plugin.
PLUGINS = "plugins"
#: Largest size of all files of a submission together [bytes]: the repository keeps them forever.
MOST_BYTES = 10_000_000

_FORMAT = 1


@dataclass(frozen=True)
class Submission:
    """A run as it was submitted.

    Attributes:
        folder: folder of the submission.
        name: name of the submission.
        runs: provenance of its rows; their suites name plugins by their path in the folder.
        files: SHA-256 of every other file, by its path in the folder.
    """

    folder: Path
    name: str
    runs: tuple[Provenance, ...]
    files: Mapping[str, str]

    def suites(self, home: Path) -> list[Suite]:
        """Suites of the runs, with plugins located in the folder ``home``, which has ``PLUGINS``.

        Raises:
            UserError: on a plugin that is not a file of the submission.
        """
        return [self._at(home, read_suite_json(run.suite)) for run in self.runs]

    def _at(self, home: Path, suite: Suite) -> Suite:
        estimators = []
        for entry in suite.estimators:
            place, suffix, class_name = entry.name.rpartition(".py")
            if suffix and place + suffix not in self.files:
                raise UserError(
                    f"{self.folder}: the plugin {place}.py of estimator {entry.label!r} is missing"
                )
            located = f"{home / place}{suffix}{class_name}" if suffix else entry.name
            estimators.append(entry.model_copy(update={"name": located}))
        return suite.model_copy(update={"estimators": tuple(estimators)})


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


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
    """Read a submission, and check its files against its manifest.

    Raises:
        UserError: if there is no submission, it has another format, or a file is missing, was
            changed, or cannot be part of a submission.
    """
    path = folder / MANIFEST
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        if stored["format"] != _FORMAT:
            raise UserError(
                f"{path} has the format {stored['format']}, this version of olne-bench knows "
                f"{_FORMAT}"
            )
        runs = tuple(read_provenance(json.dumps(run)) for run in stored["runs"])
        found = Submission(folder, str(stored["name"]), runs, dict(stored["files"]))
    except OSError as error:
        raise UserError(f"no submission in {folder}: it has no {MANIFEST}") from error
    except (ValueError, TypeError, KeyError) as error:
        raise UserError(f"{path} is not the manifest of a submission: {error!r}") from error
    _check_files(found)
    if not runs or ROWS not in found.files:
        raise UserError(f"{path} names no {'run' if not runs else ROWS}")
    return found


def _check_files(submission: Submission) -> None:
    folder = submission.folder
    size = 0
    for place, expected in submission.files.items():
        parts = PurePosixPath(place)
        path = folder / parts
        if parts.is_absolute() or ".." in parts.parts or _is_linked(folder, parts):
            raise UserError(f"{folder}: {place!r} is not a file within a submission")
        if not path.is_file():
            raise UserError(f"{folder}: {place} is missing")
        size += path.stat().st_size
        if digest(path) != expected:
            raise UserError(f"{folder}: {place} was changed after it was submitted")
    if size > MOST_BYTES:
        raise UserError(f"{folder}: its files have {size} bytes; at most {MOST_BYTES} are allowed")


def _is_linked(folder: Path, place: PurePosixPath) -> bool:
    steps = (place, *place.parents)
    return any((folder / step).is_symlink() for step in steps if step != PurePosixPath("."))

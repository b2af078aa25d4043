"""Provenance of rows: software, commit, machine and the suite of the run."""

import json
import os
import platform
import subprocess
import sys
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from packaging.requirements import Requirement

from olne_bench.bench.plan.select import Selection
from olne_bench.bench.plan.values import cut
from olne_bench.bench.plan.versions import environment
from olne_bench.errors import UserError

_DISTRIBUTION = "olne-bench"


@dataclass(frozen=True)
class Provenance:
    """One ``olne-bench run``.

    Attributes:
        started: wall-clock time, UTC, ISO 8601; for people only, nothing is ordered by it.
        suite: the suite with all plugins, as JSON.
        suite_text: text of the suite's file.
        selection: the selected part of the suite.
        seeds: number of noise draws; draw ``k`` has the seed ``k``.
        executor: where trials ran.
        versions: versions of Python and the packages that this benchmark requires.
        environment: versions that ``Versions.environment`` covers.
        commit: git commit of this benchmark, with the suffix ``-dirty`` if files were changed;
            empty if it was not run from a repository.
        machine: system, processor, cores and memory of the driver.
    """

    started: str
    suite: str
    suite_text: str
    selection: Selection
    seeds: int
    executor: str
    versions: dict[str, str]
    environment: dict[str, str]
    commit: str
    machine: dict[str, str]


def provenance(
    *, suite: str, suite_text: str, selection: Selection, seeds: int, executor: str
) -> Provenance:
    """The provenance of a run that starts now, on this machine."""
    return Provenance(
        started=datetime.now(UTC).isoformat(timespec="seconds"),
        suite=suite,
        suite_text=suite_text,
        selection=selection,
        seeds=seeds,
        executor=executor,
        versions=_versions(),
        environment=dict(environment()),
        commit=_commit(),
        machine=_machine(),
    )


def provenance_json(source: Provenance) -> str:
    """A provenance as JSON, as stores hold it."""
    data = {f.name: getattr(source, f.name) for f in fields(Provenance)}
    return json.dumps(data | {"selection": source.selection.model_dump()})


def read_provenance(text: str) -> Provenance:
    """Read a stored provenance; fields that later versions add are ignored.

    Raises:
        UserError: if the text is not a provenance.
    """
    try:
        stored = json.loads(text)
        data = {f.name: stored[f.name] for f in fields(Provenance)}
        data["selection"] = Selection.model_validate_json(json.dumps(stored["selection"]))
        return Provenance(**data)
    except (ValueError, TypeError, KeyError) as error:  # pydantic's are ValueErrors
        raise UserError(
            f"what the store says of its runs cannot be read ({cut(repr(error))}): it is damaged, "
            "or of another version of olne-bench"
        ) from error


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    try:
        required = [Requirement(line) for line in requires(_DISTRIBUTION) or []]
    except PackageNotFoundError:  # run from a folder that was never installed
        return found
    needed = {r.name for r in required if r.marker is None or r.marker.evaluate({"extra": ""})}
    for name in sorted({_DISTRIBUTION, *needed}):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    return found


def _commit() -> str:
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        described = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=30
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return described.stdout.strip()


def _machine() -> dict[str, str]:
    machine = {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": str(os.cpu_count()),
    }
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        machine["memory"] = f"{size / 2**30:.1f} GiB"
    return machine


def _processor() -> str:
    if sys.platform == "linux":
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()

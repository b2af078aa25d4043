"""Which of ``results/`` earlier code has made.

    python scripts/stale_results.py               # a line a study; exit code 1 if one is old
    python scripts/stale_results.py --record people perf      # the present code has just made these
    python scripts/stale_results.py --record encounters --run runs/encounters   # its rows tell

``results/versions.csv`` holds the fingerprints of the code that made a study: of each estimator,
scenario and sensor of a suite and of its scoring, or of the modules that a script uses. Versions of
libraries are not compared. ``docs/findings.md`` says how many are old, and a test compares.
"""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import shared
import pandas as pd

import olne_bench as ob
from olne_bench.bench.plan.fingerprint import fingerprint
from olne_bench.bench.plan.kinds import StudyKind
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.trial import alike

RESULTS = Path(__file__).parents[1] / "results"
PACKAGE = Path(str(ob.__file__)).parent
TABLE = RESULTS / "versions.csv"
#: Studies, most of them folders of ``results/``, and the suites that make them.
SUITES = {
    **{name: (name,) for name in ("paper", "sensors", "field", "parameters", "constrained")},
    **{name: (name,) for name in ("calibration", "online", "encounters", "misspecified", "roads")},
    "several_trajectories": ("several",),
    "driving": ("driving",),
    "driving_stock": ("driving_stock",),
    "learned": (str(RESULTS / "learned/learned.toml"), str(RESULTS / "learned/online.toml")),
    "predictions": ("roads",),
    "again": ("roads",),
}
#: A part of a suite, run as another kind: only what its rows have is compared.
AS_KIND: dict[str, StudyKind] = {"predictions": "streams"}
#: Folders that a script or a command makes, and modules that decide their numbers.
MODULES = {
    "behaviours": ("front.behaving", "envs.scenarios.changed", "envs.tracks.explained"),
    "people": ("bench.people.study",),
    "perf": ("estimators.kkt_constrained", "games.solve.olne", "games.solve.batch"),
    "traffic": ("envs.traffic.nash_gym",),
    "rl": ("envs.drive.ego_env",),
    "unknowns": ("estimators.kkt_constrained", "estimators.ukf", "games.solve.information"),
    "constraints": ("games.solve.constrained", "estimators.bilevel"),
}


def main(record: tuple[str, ...] = (), run: tuple[Path, ...] = ()) -> int:
    """List what is old, after recording some by the present code, or by the rows of runs."""
    for study in record:
        if study not in {*SUITES, *MODULES}:
            known = ", ".join(sorted({*SUITES, *MODULES}))
            print(f"no study {study!r}; there are {known}")
            return 2
    for study in record:
        rows = [ob.read(part).trials for part in run]
        remember(study, versions_in(pd.concat(rows)) if rows else _rows(study))
    changed = {study: _changed(study) for study in sorted({*SUITES, *MODULES})}
    for study, parts in changed.items():
        print(f"{study}: {_said(parts) or 'made by this code'}")
    return int(any(changed.values()) and not record)


def _said(parts: list[str]) -> str:
    """What has changed, and of much, the first; empty if nothing has."""
    others = f" and {len(parts) - 3} others" if len(parts) > 4 else ""
    few = parts[:3] if others else parts
    return f"older: {'; '.join(few)}{others}" if few else ""


def remember(study: str, parts: dict[str, str]) -> None:
    """Note with what a study was made."""
    kept = _recorded()
    new = pd.DataFrame({"study": study, "part": parts.keys(), "version": parts.values()})
    table = pd.concat([kept[kept["study"] != study], new])
    table.sort_values(["study", "part"]).to_csv(TABLE, index=False)


def versions_in(rows: pd.DataFrame) -> dict[str, str]:
    """Parts and versions of the rows of a run; a part of several versions has all."""
    found: dict[str, set[str]] = {"scoring": set(rows["scoring_version"])}
    for kind in ("estimator", "scenario", "sensor"):
        for label, own in rows.groupby(kind)[f"{kind}_version"]:
            found[f"{kind} {label}"] = set(own)
    return {part: " ".join(sorted(all_)) for part, all_ in found.items() if all_ != {""}}


def old() -> list[str]:
    """Studies that other code has made."""
    return [study for study in sorted({*SUITES, *MODULES}) if _changed(study)]


def _changed(study: str) -> list[str]:
    """Parts of a study whose code has changed since it was made."""
    kept = _recorded()
    own = kept[kept["study"] == study]
    known = dict(zip(own["part"], own["version"], strict=True))
    if not known:
        return ["never recorded"]
    now = _rows(study)
    if study in AS_KIND:
        now = {part: version for part, version in now.items() if part in known}
    return [part for part, version in now.items() if known.get(part) != version]


def _recorded() -> pd.DataFrame:
    if TABLE.exists():
        return pd.read_csv(TABLE, dtype=str)
    return pd.DataFrame(columns=["study", "part", "version"])


@lru_cache
def _rows(study: str) -> dict[str, str]:
    """Parts and versions of the code that would make a study now."""
    if study in MODULES:
        paths = {
            f"olne_bench.{name}": PACKAGE.joinpath(*name.split(".")).with_suffix(".py")
            for name in MODULES[study]
        }
        code = fingerprint(paths, {"olne_bench": PACKAGE.parent}, own=None)
        return {"code": code}
    found: dict[str, set[str]] = {}
    for name in SUITES[study]:
        for part, version in _parts(name, AS_KIND.get(study)):
            found.setdefault(part, set()).add(version)
    return {part: " ".join(sorted(all_)) for part, all_ in found.items()}


def _parts(name: str, kind: StudyKind | None = None) -> Iterator[tuple[str, str]]:
    """Estimators, scenarios and sensors of a suite, and its scoring, with their versions."""
    suite = load_suite(name)
    for trial, _ in alike(suite.model_copy(update={"kind": kind or suite.kind})):
        here = trial.versions
        yield f"estimator {trial.estimator.label}", here.estimator
        yield "scoring", here.scoring
        if here.scenario:  # that of drives is a part of what judges them
            yield f"scenario {trial.scenario.label}", here.scenario
            yield f"sensor {trial.sensor.label}", here.sensor


if __name__ == "__main__":
    shared.command(main)

"""``olne-bench compare``: what got better or worse from one run to another."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import click
import pandas as pd

from olne_bench.bench.judge.scene import NoScenes
from olne_bench.bench.plan.suite import salt_id
from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.report.statistics.pairs import compare_runs
from olne_bench.bench.report.statistics.standing import plausible, said_of_standing, standings
from olne_bench.bench.report.study import FAILURES, Study, study_in
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.store import read_store
from olne_bench.errors import UserError
from olne_bench.files import check_new_file, whole_file


def compare(
    before: Path, after: Path, estimators: tuple[str, ...], out: Path | None, page: Path | None
) -> None:
    """Compare two runs trial by trial, on the same noise."""
    if out is not None:
        check_new_file("--out", out, (".csv",))
    if page is not None:
        check_new_file("--page", page, (".html",))
    first, second = (_read(folder) for folder in (before, after))
    old, new = first.trials, second.trials
    study = _common(first.study, second.study)
    names = _names(estimators, old, new, before, after)
    table = compare_runs(*_comparable(first, second, names), names, study)
    reasons = _reasons(first, second, names)
    if table.empty:
        raise UserError(
            f"{before} and {after} have no trial with noise in common"
            + (f" that can be compared; {reasons[0]}" if reasons else "")
        )
    if out is not None:
        write_csv(table, out)
    if page is not None:
        _write_page(page, first, second, names, table, study)
    click.echo(_format(table))
    notes = [*reasons, *_other_noise(first, second), *_notes(old, new, names, before, after)]
    for note in notes:
        click.echo(f"note: {note}", err=True)
    counts = table["verdict"].value_counts()
    click.echo(", ".join(f"{counts.get(v, 0)} {v}" for v in ("better", "same", "worse")))
    sys.exit(1 if counts.get("worse", 0) else 0)


@dataclass(frozen=True)
class _Run:
    """The parts of a run that are compared."""

    folder: Path
    trials: pd.DataFrame
    study: Study
    sources: list[Provenance]
    standing: pd.DataFrame


def _read(folder: Path) -> _Run:
    with read_store(folder) as store:
        trials, runs, study = store.frame(), store.runs(), study_in(folder, store)
    if trials.empty:
        raise UserError(f"the run in {folder} has no finished trial yet")
    return _Run(folder, trials, study, runs, standings(trials, study))


def _comparable(
    first: _Run, second: _Run, names: Mapping[str, str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The trials of both runs that tell what is better.

    Implausible ones tell nothing, nor do published weights of a plugin and an estimator of ours.
    """
    old, new = (plausible(run.trials, run.standing) for run in (first, second))
    mixed = [a for a, b in names.items() if first.study.is_foreign(a) != second.study.is_foreign(b)]
    known = {label: first.study.is_published(label) for label in old["scenario"].unique()}
    return old[~(old["estimator"].isin(mixed) & old["scenario"].map(known).astype(bool))], new


def _reasons(first: _Run, second: _Run, names: Mapping[str, str]) -> list[str]:
    """Why some of the estimators do not rank, each once."""
    tables = [
        run.standing[run.standing["estimator"].isin(labels)]
        for run, labels in ((first, list(names)), (second, list(names.values())))
    ]
    return list(dict.fromkeys(line for table in tables for line in said_of_standing(table)))


def _write_page(
    place: Path,
    first: _Run,
    second: _Run,
    names: dict[str, str],
    changes: pd.DataFrame,
    study: Study,
) -> None:
    # Drawing is slow to import.
    from olne_bench.bench.report.page.render import ScenesOfBoth, after_name, two_runs_page

    renamed = [
        replace(one, estimator=after_name(one.estimator, names))
        for one in second.study.confirmations
    ]
    same = first.study.salt == second.study.salt
    scenes = ScenesOfBoth(
        first.study.scenes,
        second.study.scenes if same else NoScenes(),
        {after_name(label, names): label for label in names.values()},
    )
    known = (*first.study.confirmations, *renamed)
    study = replace(study, confirmations=known, scenes=scenes)
    html = two_runs_page(
        (str(first.folder), first.trials, first.sources),
        (str(second.folder), second.trials, second.sources),
        names,
        changes,
        study,
    )
    with whole_file(place) as path:
        path.write_text(html, encoding="utf-8")
    click.echo(f"{place}: both runs on one page")


def _common(one: Study, other: Study) -> Study:
    """The study of both runs, with the metrics that both have."""
    names = [metric.name for metric in one.metrics]
    return Study(
        tuple(metric for metric in other.metrics if metric.name in names),
        {**one.scenarios, **other.scenarios},
        {**one.sensors, **other.sensors},
        one.salt,
        {**one.estimators, **other.estimators},
    )


def _other_noise(first: _Run, second: _Run) -> list[str]:
    one, other = first.study.salt, second.study.salt
    if one == other:
        return []
    return [
        f"{first.folder} has the salt {salt_id(one)}, {second.folder} {salt_id(other)}: pairs "
        "of trials share their noise level, not their noise"
    ]


def _notes(
    old: pd.DataFrame, new: pd.DataFrame, names: dict[str, str], before: Path, after: Path
) -> list[str]:
    """Notes on what a comparison of common trials leaves out."""
    notes = []
    suites = [", ".join(sorted(trials["suite"].unique())) for trials in (old, new)]
    if suites[0] != suites[1]:
        notes.append(
            f"{before} is a run of suite {suites[0]}, {after} of {suites[1]}; only trials "
            "that both have are compared"
        )
    places = ["scenario", "sensor", "sigma", "seed"]
    mine = old[old["estimator"].isin(names)]
    mine = mine.assign(estimator=mine["estimator"].map(names))
    there = mine.merge(new[[*places, "estimator"]], on=[*places, "estimator"])
    if len(there) < len(mine):
        notes.append(
            f"{len(mine) - len(there)} of {len(mine)} trials in {before} are not in {after}"
        )
    gone = sorted(set(old["estimator"]) - set(names)) if len(names) > 1 else []
    gone = [name for name in gone if name not in set(new["estimator"])]
    if gone:
        notes.append(f"{after} has no {', '.join(gone)}")
    return notes


def _names(
    chosen: tuple[str, ...], old: pd.DataFrame, new: pd.DataFrame, before: Path, after: Path
) -> dict[str, str]:
    known = [sorted(trials["estimator"].unique()) for trials in (old, new)]
    if not chosen:
        return {name: name for name in known[0] if name in known[1]}
    names = {}
    for text in chosen:
        name, _, other = text.partition("=")
        for label, labels, place in ((name, known[0], before), (other or name, known[1], after)):
            if label not in labels:
                raise UserError(
                    f"--estimator {text}: {place} has no {label!r}; it has: {', '.join(labels)}"
                )
        names[name] = other or name
    return names


def _format(table: pd.DataFrame) -> str:
    shown = table[["verdict", "error", "scenario", "sensor", "estimator"]].copy()
    shown["estimator"] = [
        a if a == b else f"{a} -> {b}"
        for a, b in table[["estimator", "other"]].itertuples(index=False)
    ]
    values = table[["error", "before", "after", "pairs"]].itertuples(index=False)
    shown["median, or failures"] = [
        f"{a * n:.0f} of {n} -> {b * n:.0f} of {n}"
        if error == FAILURES.name
        else f"{a:.3g} -> {b:.3g}"
        for error, a, b, n in values
    ]
    shares = 100 * table[["better", "better_low", "better_high"]]
    shown["better on"] = [
        f"{a:.1f} %" + (f" [{b:.1f}, {c:.1f}]" if b == b else "")  # too few pairs give no interval
        for a, b, c in shares.itertuples(index=False)
    ]
    shown["p (Holm)"] = table["p_holm"].map("{:.2g}".format)
    shown["trials"] = table["pairs"]
    return shown.to_string(index=False)

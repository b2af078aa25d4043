"""``olne-bench merge``: merge two runs into one."""

from pathlib import Path

import click

from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import check_same_suite, last_suite
from olne_bench.bench.run.store import open_store, read_store
from olne_bench.bench.run.store_layout import FILE_NAME
from olne_bench.errors import UserError
from olne_bench.files import check_folder, whole_folder


def merge(first: Path, second: Path, out: Path | None) -> None:
    """Add the trials of the run in SECOND to those of the run in FIRST."""
    if first.resolve() == second.resolve():
        raise UserError(f"cannot merge {first} with itself")
    former, latest = _runs(first), _runs(second)
    last_suite(former, first)  # refuses a folder without a run
    check_same_suite(last_suite(latest, second), former, first, f"leave {second} on its own")
    if out is None:
        _say(first, _added(first, [second]))
        return
    check_folder(out, (FILE_NAME,))
    if (out / FILE_NAME).exists():
        raise UserError(f"--out {out} holds a run already; name a new folder")
    with whole_folder(out) as unfinished:
        said = _added(unfinished, [first, second])
    _say(out, said)


def _runs(folder: Path) -> list[Provenance]:
    with read_store(folder) as store:
        store.check()  # before anything is written
        return store.runs()


def _added(target: Path, sources: list[Path]) -> list[str]:
    """Add rows to a run; a text on what came from each source."""
    said = []
    with open_store(target) as store:
        for source in sources:
            with open_store(source):  # no other process writes to it meanwhile
                new, known = store.merge(source / FILE_NAME)
            kept = f", {known} were there before" if known else ""
            said.append(f"{new} rows of {source} added{kept}")
    return said


def _say(target: Path, said: list[str]) -> None:
    for line in said:
        click.echo(f"{target}: {line}")

"""``olne-bench merge``: merge two runs into one."""

from pathlib import Path

import click

from olne_bench.bench.commands.options import PATH
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import check_same_suite, last_suite
from olne_bench.bench.run.store import open_store, read_store
from olne_bench.bench.run.store_layout import FILE_NAME
from olne_bench.errors import UserError


@click.command()
@click.argument("first", type=PATH)
@click.argument("second", type=PATH)
@click.option(
    "--out", type=PATH, help="New run folder for the result. Without it, FIRST gets the rows."
)
def merge(first: Path, second: Path, out: Path | None) -> None:
    """Add the trials of the run in SECOND to those of the run in FIRST.

    Both must be runs of the same suite; that of SECOND may have more estimators and scenarios.
    What they share must have the same code and parameters. If both have a trial, the row of FIRST
    is kept. SECOND does not change.
    """
    if first.resolve() == second.resolve():
        raise UserError(f"cannot merge {first} with itself")
    former, latest = _runs(first), _runs(second)
    last_suite(former, first)  # refuses a folder without a run
    check_same_suite(last_suite(latest, second), former, first, f"leave {second} on its own")
    if out is None:
        _add(first, [second])
        return
    if (out / FILE_NAME).exists():
        raise UserError(f"--out {out} holds a run already; name a new folder")
    _add(out, [first, second])


def _runs(folder: Path) -> list[Provenance]:
    with read_store(folder) as store:
        return store.runs()


def _add(target: Path, sources: list[Path]) -> None:
    with open_store(target) as store:
        for source in sources:
            with open_store(source):  # no other process writes to it meanwhile
                new, known = store.merge(source / FILE_NAME)
            kept = f", {known} were there before" if known else ""
            click.echo(f"{target}: {new} rows of {source} added{kept}")

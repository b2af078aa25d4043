"""``olne-bench merge``: one run out of two."""

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
@click.option("--out", type=PATH, help="New run folder; FIRST gains the rows if absent.")
def merge(first: Path, second: Path, out: Path | None) -> None:
    """Add the trials of the run in SECOND to those of the run in FIRST.

    Both have to be of the same suite, and of the same code and parameters where they share an
    estimator and a scenario; the suite of SECOND may have more in it. Of a trial that both have,
    the row of FIRST stays. SECOND is left as it is.
    """
    if first.resolve() == second.resolve():
        raise UserError(f"cannot merge {first} with itself")
    former, latest = _runs(first), _runs(second)
    last_suite(former, first)  # there has to be one
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
            with open_store(source):  # nobody writes to it meanwhile
                new, known = store.merge(source / FILE_NAME)
            kept = f", {known} were there already" if known else ""
            click.echo(f"{target}: {new} rows of {source} added{kept}")

"""``olne-bench submit``: pack a run for a pull request."""

from pathlib import Path

import click

from olne_bench.bench.commands.options import SUBMISSIONS
from olne_bench.bench.run.resume import kind_of
from olne_bench.bench.submission.manifest import check_name
from olne_bench.bench.submission.pack import pack
from olne_bench.errors import UserError


def submit(folder: Path, name: str | None, out: Path | None) -> None:
    """Pack the run in RUN for a pull request."""
    chosen = name or folder.resolve().name
    check_name(chosen, "--name")
    kind = kind_of(folder)
    if kind != "trials":
        raise UserError(f"the run in {folder} is a study of {kind}; only trials can be submitted")
    target = out or SUBMISSIONS / chosen
    rows = pack(folder, chosen, target)
    click.echo(f"{target}: {rows} rows packed; check them with: olne-bench verify {target}")

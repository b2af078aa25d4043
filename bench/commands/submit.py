"""``olne-bench submit``: pack a run for a pull request."""

import re
from pathlib import Path

import click

from olne_bench.bench.commands.options import PATH
from olne_bench.bench.report.submission.pack import pack
from olne_bench.errors import UserError

_PLACE = Path("results/submissions")
_NAME = re.compile(r"[a-z0-9][a-z0-9_.-]{0,59}")


@click.command()
@click.argument("folder", metavar="RUN", type=PATH)
@click.option("--name", help="Name of the submission. Default: that of the run folder.")
@click.option("--out", type=PATH, help=f"New folder. Default: {_PLACE}/NAME.")
def submit(folder: Path, name: str | None, out: Path | None) -> None:
    """Pack the run in RUN for a pull request.

    The folder holds the rows, the leaderboard, the source of the estimators that are plugins, and
    their provenance: suite with salt, versions, commit, and hashes of the files. Every trial must
    have been run with the present code. 'olne-bench verify' checks the folder.
    """
    chosen = name or folder.resolve().name
    if not _NAME.fullmatch(chosen):
        raise UserError(
            f"--name {chosen!r}: a name has 1 to 60 of a-z, 0-9, '_', '-' and '.', and starts with "
            "a letter or digit"
        )
    target = out or _PLACE / chosen
    rows = pack(folder, chosen, target)
    click.echo(f"{target}: {rows} rows packed; check them with: olne-bench verify {target}")

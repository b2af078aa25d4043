"""``olne-bench report``: tables, page and figures of a run, once more."""

from collections.abc import Sequence
from pathlib import Path

import click

from olne_bench.bench.commands.options import PATH
from olne_bench.bench.report.figures import FORMATS, USUAL_FORMATS
from olne_bench.bench.report.leaderboard_terminal import format_leaderboard, format_notes
from olne_bench.bench.report.write import write_report
from olne_bench.errors import UserError


@click.command()
@click.argument("folder", type=PATH)
@click.option(
    "--figures/--no-figures", default=True, show_default=True, help="Draw the figures as well."
)
@click.option(
    "--formats",
    default=",".join(USUAL_FORMATS),
    show_default=True,
    help=f"Formats of the figures, out of {', '.join(FORMATS)}.",
)
def report(folder: Path, figures: bool, formats: str) -> None:
    """Write tables, page and figures of the run in FOLDER once more."""
    show_report(folder, read_formats(formats) if figures else ())


def read_formats(text: str) -> tuple[str, ...]:
    """Formats from their names with commas in between.

    Raises:
        UserError: on one that is not known.
    """
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in FORMATS:
            raise UserError(f"--formats {text}: unknown {name!r}; known are: {', '.join(FORMATS)}")
    return names


def show_report(folder: Path, formats: Sequence[str]) -> None:
    """Write a run's report, with figures in these formats, and print its leaderboard."""
    report = write_report(folder, formats)
    click.echo(format_leaderboard(report.tables.leaderboard, report.study))
    said = format_notes(report.tables, report.notes)
    if said:
        click.echo(f"\n{said}")
    click.echo(
        f"\n{folder}: index.html, leaderboard.csv, trials.csv, trials.parquet and other tables"
        + (", figures/" if formats else "")
    )

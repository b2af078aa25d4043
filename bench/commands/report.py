"""``olne-bench report``: tables and figures of a run, once more."""

from pathlib import Path

import click

from bench.report import format_leaderboard, write_report


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option(
    "--figures/--no-figures", default=True, show_default=True, help="Draw the figures as well."
)
def report(folder: Path, figures: bool) -> None:
    """Write tables and figures of the run in FOLDER once more."""
    show_report(folder, figures)


def show_report(folder: Path, figures: bool) -> None:
    """Write a run's report and print its leaderboard."""
    table = write_report(folder, figures=figures)
    click.echo(format_leaderboard(table))
    click.echo(
        f"\n{folder}: index.html, leaderboard.csv, trials.csv, trials.parquet and other tables"
        + (", figures/" if figures else "")
    )

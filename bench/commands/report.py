"""``olne-bench report``: write the tables, page and figures of a run again."""

from collections.abc import Sequence
from pathlib import Path

import click

from olne_bench.bench.commands.options import plain_number, whole_number
from olne_bench.bench.process import nursery
from olne_bench.bench.process.child import Child, ChildError, RaisedError
from olne_bench.bench.report.formats import read_formats
from olne_bench.bench.run.resume import kind_of
from olne_bench.errors import UserError

#: Time [s] after which a report is written here instead.
_SECONDS = 7200.0
#: Noise level and seed.
Place = tuple[float, int]


def report(folder: Path, figures: bool, formats: str, playable: tuple[str, ...]) -> None:
    """Write the tables, page and figures of the run in FOLDER again."""
    show_report(folder, read_formats(formats) if figures else (), [_place(t) for t in playable])


def _place(text: str) -> Place:
    sigma, _, seed = text.partition(":")
    try:
        return plain_number(sigma), whole_number(seed)
    except ValueError:
        raise UserError(f"--play {text!r}: expected SIGMA:SEED, such as 0.05:3") from None


def show_report(folder: Path, formats: Sequence[str], playable: Sequence[Place] = ()) -> None:
    """Write a run's report, with figures in these formats, and print its leaderboard.

    No figures are drawn if there are no formats. The page can play the trials of ``playable``. It
    is written where the nursery has imported all that is needed, if this process has one.
    """
    given = folder, formats, playable
    if not nursery.has_begun():
        click.echo(report_text(*given))
        return
    child = Child(has_children=True)
    try:
        said = child.call(report_text, *given, kind=str, seconds=_SECONDS)
    except (ChildError, RaisedError):
        said = report_text(*given)  # which says what is wrong
    finally:
        child.stop()
    click.echo(said)


def report_text(folder: Path, formats: Sequence[str], playable: Sequence[Place]) -> str:
    """Write a run's report; what is said of it."""
    kind = kind_of(folder)
    if kind != "trials" and playable:
        click.echo(f"note: --play is ignored: pages of {kind} play no trials", err=True)
    if kind == "streams":
        from olne_bench.bench.report.write import report_streams

        return report_streams(folder, formats)
    if kind == "drives":
        from olne_bench.bench.report.write import report_drives

        return report_drives(folder, formats)
    from olne_bench.bench.report.leaderboard_text import format_board, format_notes
    from olne_bench.bench.report.write import write_report

    report = write_report(folder, formats, playable)
    said = format_notes(report.tables, report.notes)
    files = "index.html shows all numbers; leaderboard.csv, trials.csv and other tables"
    parts = [
        format_board(report.tables, report.study),
        *([said] if said else []),
        f"{folder}: {files}{', figures/' if formats else ''}",
    ]
    return "\n\n".join(parts)

"""``olne-bench report``: write the tables, page and figures of a run again."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import click

from olne_bench import plugins
from olne_bench.bench.commands.options import plain_number, whole_number
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import foreign_worlds
from olne_bench.bench.process.child import Child, ChildError, RaisedError
from olne_bench.bench.report.formats import read_formats
from olne_bench.bench.run.resume import kind_of
from olne_bench.errors import UserError

#: A report that takes longer [s] hangs.
_LONGEST = 86_400.0
#: Noise level and seed.
Place = tuple[float, int]


def report(
    folder: Path, figures: bool, formats: str, playable: tuple[str, ...], loaded: tuple[str, ...]
) -> None:
    """Write the tables, page and figures of the run in FOLDER again."""
    places = tuple(_place(text) for text in playable)
    show_report(folder, read_formats(formats) if figures else (), places, loaded)


def _place(text: str) -> Place:
    sigma, _, seed = text.partition(":")
    try:
        return plain_number(sigma), whole_number(seed)
    except ValueError:
        raise UserError(f"--play {text!r}: expected SIGMA:SEED, such as 0.05:3") from None


def show_report(
    folder: Path, formats: Sequence[str], playable: Sequence[Place] = (), loaded: Sequence[str] = ()
) -> None:
    """Write a run's report, with figures in these formats, and print its leaderboard.

    A report plays the scenarios again. Those that are plugins are played only if they are among
    the loaded ones, in another process, because this one imports no plugin.
    """
    given = (folder, tuple(formats), tuple(playable), tuple(map(plugins.absolute, loaded)))
    if not loaded:
        click.echo(_report_text(*given))
        return
    child = Child()
    try:
        text = child.call(_report_text, *given, kind=str, seconds=_LONGEST)
    except (ChildError, RaisedError) as error:
        raise UserError(
            f"the report of {folder} cannot be made: {error}; the trials are stored"
        ) from error
    finally:
        child.stop()
    click.echo(text)


def worlds_of(suite: Suite) -> list[str]:
    """References of the scenarios and sensors of a suite that are plugins."""
    pairs = product(suite.scenarios, suite.sensors)
    return [name for scenario, sensor in pairs for name in foreign_worlds(scenario, sensor)]


def _report_text(
    folder: Path, formats: tuple[str, ...], playable: tuple[Place, ...], loaded: tuple[str, ...]
) -> str:
    kind = kind_of(folder)
    if kind != "trials" and playable:
        click.echo(f"note: --play is ignored: pages of {kind} play no trials", err=True)
    if kind == "streams":
        from olne_bench.bench.report.write import report_streams

        return report_streams(folder, formats)
    if kind == "drives":
        from olne_bench.bench.report.write import report_drives

        return report_drives(folder, formats)
    from olne_bench.bench.report.leaderboard_text import format_leaderboard, format_notes
    from olne_bench.bench.report.write import write_report

    with plugins.loading(*loaded):
        report = write_report(folder, formats, playable)
    said = format_notes(report.tables, report.notes)
    files = "index.html, leaderboard.csv, trials.csv, trials.parquet and other tables"
    parts = [
        format_leaderboard(report.tables.leaderboard, report.study),
        *([said] if said else []),
        f"{folder}: {files}{', figures/' if formats else ''}",
    ]
    return "\n\n".join(parts)

"""``olne-bench run``: run a suite, or continue an interrupted run."""

from dataclasses import dataclass
from typing import Any

import click

from olne_bench.bench.commands.going_on import StudyOptions, go_on, leave
from olne_bench.bench.commands.report import show_report, worlds_of
from olne_bench.bench.report.formats import read_formats
from olne_bench.bench.run.store import open_store
from olne_bench.bench.run.study import load_study


@dataclass(frozen=True, kw_only=True)
class RunOptions(StudyOptions):
    """The options of ``olne-bench run``."""

    report: bool
    formats: str


def run(suite: str, **options: Any) -> None:
    """Run SUITE, a name or a TOML file."""
    chosen = RunOptions(suite=suite, **options)
    drawn = read_formats(chosen.formats) if chosen.figures else ()
    whole = load_study(chosen.wanted, chosen)
    with open_store(chosen.out) as store:
        interrupted = go_on(whole, chosen, store)
    leave(interrupted)
    if chosen.report:
        show_report(chosen.out, drawn, loaded=worlds_of(whole))
    else:
        click.echo(
            f"{chosen.out}: to write its tables and page, run 'olne-bench report {chosen.out}'"
        )

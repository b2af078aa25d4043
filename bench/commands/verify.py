"""``olne-bench verify``: check submissions."""

import secrets
import sys
from pathlib import Path

import click

from olne_bench.bench.commands.options import JOBS, PATH, memory_option
from olne_bench.bench.report.submission.fresh import FreshErrors
from olne_bench.bench.report.submission.manifest import read_submission
from olne_bench.bench.report.submission.verify import Limits, Verdict
from olne_bench.bench.report.submission.verify import verify as check
from olne_bench.files import check_new_file, whole_file

#: Number of differing rows that are shown.
_SHOWN = 5


@click.command()
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=PATH)
@click.option(
    "--sample",
    type=click.IntRange(1, 10**6),
    default=20,
    show_default=True,
    help="Number of trials to run again as they are, and again with a fresh salt.",
)
@click.option("--seed", type=click.IntRange(0), help="Seed of the choice of trials, to repeat it.")
@click.option("--strict", is_flag=True, help="Refuse rows of other versions of code or libraries.")
@click.option("--jobs", type=JOBS, default=2, show_default=True)
@memory_option("Memory that a worker process may use.")
@click.option("--page", type=PATH, help="New .html file for a page of the accepted submissions.")
def verify(
    folders: tuple[Path, ...],
    sample: int,
    seed: int | None,
    strict: bool,
    jobs: int,
    memory: float,
    page: Path | None,
) -> None:
    """Check the submissions in FOLDER..., as 'olne-bench submit' packs them.

    A sample of the rows is run again and must come out the same, bit by bit. As many trials are run
    with a fresh salt: a submission is refused if their errors are significantly larger than the
    submitted ones. Rows of other versions of code or libraries cannot be repeated bit by bit; for
    them only the fresh salt decides.

    Exit code 0 if all are accepted, 1 if one is not, 2 on bad input, such as a changed file.
    """
    if page is not None:
        check_new_file("--page", page, (".html",))
    chosen = secrets.randbits(32) if seed is None else seed
    accepted: dict[Path, Verdict] = {}
    for folder in folders:
        verdict = check(folder, Limits(sample, chosen, jobs, int(memory * 2**30), strict))
        click.echo("\n".join(_lines(folder, verdict, chosen)))
        if verdict.accepted:
            accepted[folder] = verdict
    if page is not None and accepted:
        _write_page(page, accepted)
    sys.exit(0 if len(accepted) == len(set(folders)) else 1)


def _write_page(place: Path, accepted: dict[Path, Verdict]) -> None:
    from olne_bench.bench.report.page.accepted import Accepted, accepted_page  # slow to import

    found = [
        Accepted(
            read_submission(folder),
            f"{verdict.identical} rows run again, all the same; "
            f"{sum(one.trials for one in verdict.fresh)} trials with a fresh salt",
        )
        for folder, verdict in accepted.items()
    ]
    with whole_file(place) as path:
        path.write_text(accepted_page(found), encoding="utf-8")
    click.echo(f"{place}: {len(found)} accepted")


def _lines(folder: Path, verdict: Verdict, seed: int) -> list[str]:
    repeated = verdict.identical + len(verdict.differing)
    lines = [f"{folder}: {verdict.rows} rows, complete; the leaderboard matches them"]
    if verdict.other_versions:
        lines.append(
            f"  {verdict.other_versions} rows cannot be repeated bit by bit: {verdict.because}"
        )
    if repeated:
        lines.append(f"  {verdict.identical} of {repeated} rows run again are the same, bit by bit")
    if verdict.timed_out:
        lines.append(f"  {verdict.timed_out} rows reached their time limit and were not compared")
    lines += [f"  DIFFERS  {line}" for line in verdict.differing[:_SHOWN]]
    if len(verdict.differing) > _SHOWN:
        lines.append(f"  and {len(verdict.differing) - _SHOWN} more differ")
    lines += [_fresh_line(one) for one in verdict.fresh]
    lines += [f"  NOT JUDGED  {line}" for line in verdict.unjudged[:_SHOWN]]
    if not (repeated or any(one.decides for one in verdict.fresh)):
        lines.append("  NOTHING  could be compared")
    said = "accepted" if verdict.accepted else "refused"
    return [*lines, f"  {said} (sample of seed {seed})"]


def _fresh_line(found: FreshErrors) -> str:
    few = "" if found.decides else ", too few rows to tell"
    return (
        f"  {'fresh salt' if found.accepted else 'TOO GOOD'}  {found.estimator}: median "
        f"{found.metric} {found.submitted:.3g} submitted, {found.fresh:.3g} in {found.trials} "
        f"fresh trials, p = {found.p:.2g}{few}"
    )

"""``olne-bench verify``: check submissions."""

import secrets
import sys
from pathlib import Path

import click

from olne_bench.bench.report.confirmations import Confirmation
from olne_bench.bench.submission.drawn import REFERENCE, DrawnErrors
from olne_bench.bench.submission.fresh import FreshErrors
from olne_bench.bench.submission.manifest import read_submission
from olne_bench.bench.submission.verify import Limits, Verdict
from olne_bench.bench.submission.verify import verify as check
from olne_bench.files import check_new_file, whole_file

#: Number of differing rows that are shown.
_SHOWN = 5


def verify(
    folders: tuple[Path, ...],
    sample: int | None,
    seed: int | None,
    strict: bool,
    jobs: int,
    memory: float,
    page: Path | None,
) -> None:
    """Check the submissions in FOLDER..., as 'olne-bench submit' packs them."""
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
    from olne_bench.bench.submission.accepted_page import Accepted, accepted_page  # slow to import

    found = [
        Accepted(read_submission(folder), _summary(verdict)) for folder, verdict in accepted.items()
    ]
    with whole_file(place) as path:
        path.write_text(accepted_page(found), encoding="utf-8")
    click.echo(f"{place}: {len(found)} accepted")


def _summary(verdict: Verdict) -> str:
    said = [f"{verdict.repeated.same} rows run again, all the same"]
    if verdict.fresh:
        said.append(f"{sum(one.trials for one in verdict.fresh)} trials with fresh salts")
    if verdict.fixed:
        said.append(f"not rankable where truths are fixed: {', '.join(verdict.fixed)}")
    return "; ".join(said)


def _lines(folder: Path, verdict: Verdict, seed: int) -> list[str]:
    again = verdict.repeated
    lines = [f"{folder}: {verdict.rows} rows, complete; the leaderboard matches them"]
    if verdict.because:
        lines.append(f"  of other versions, compared within 0.1 %: {verdict.because}")
    how = "within 0.1 %" if verdict.because else "bit by bit"
    lines.append(f"  {again.same} of {again.total} rows run again are the same, {how}")
    if again.silent:
        many = ": too many" if again.too_silent else ""
        lines.append(f"  {again.silent} rows reached their time limit and were not compared{many}")
    lines += _some("DIFFERS", again.differing)
    if again.differing and verdict.because:
        lines.append("  to see whether versions are the reason, run again with those that are here")
    lines += [_implausible_line(one) for one in verdict.implausible]
    lines += [_fresh_line(one) for one in verdict.fresh]
    lines += _some("NOT JUDGED", verdict.unjudged)
    lines += [_drawn_line(one) for one in verdict.drawn]
    if verdict.fixed:
        lines.append(
            f"  NOT RANKABLE  fixed truths, which everyone can look up: {', '.join(verdict.fixed)}"
        )
    if not again.same:
        lines.append("  NOTHING  could be compared")
    said = "accepted" if verdict.accepted else "refused"
    return [*lines, f"  {said} (sample of seed {seed})"]


def _some(what: str, found: list[str]) -> list[str]:
    lines = [f"  {what}  {line}" for line in found[:_SHOWN]]
    more = len(found) - _SHOWN
    return [*lines, f"  and {more} more"] if more > 0 else lines


def _implausible_line(found: Confirmation) -> str:
    return (
        f"  {'below the limit' if found.confirmed else 'IMPLAUSIBLE'}  {found.estimator} in "
        f"{found.scenario}, {found.sensor}: {found.rows} rows far below the statistical limit, "
        f"{found.text}"
    )


def _fresh_line(found: FreshErrors) -> str:
    if not found.decides:
        return (
            f"  TOO FEW  {found.estimator} has too few draws to tell whether it knows their noise: "
            "run more seeds, noise levels or scenarios"
        )
    return (
        f"  {'fresh salt' if found.accepted else 'TOO GOOD'}  {found.estimator}: median "
        f"{found.metric} {found.submitted:.3g} submitted, {found.fresh:.3g} in {found.trials} "
        f"fresh trials, p = {found.p:.2g}"
    )


def _drawn_line(found: DrawnErrors) -> str:
    place = f"{found.estimator} in {found.scenario}"
    if not found.trials:
        return f"  drawn truths  {place}: there are none of this scenario"
    return (
        f"  {'drawn truths' if found.accepted else 'KNOWS THE TRUTH'}  {place}: median error "
        f"{found.error:.3g} on {found.trials} drawn truths, {found.reference:.3g} of "
        f"{REFERENCE.label}; ratio {found.drawn:.2g}, and {found.fixed:.2g} on the fixed ones"
    )

"""What of a suite is done already, and whether a run may go on where another one stopped."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import STATUSES, Trial
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.store import Record
from olne_bench.errors import UserError

#: What ``--retry`` takes: all failures, or one kind of them.
RETRIES = ("failed", *(status for status in STATUSES if status not in ("ok", "skipped")))


@dataclass(frozen=True)
class Progress:
    """Trials of a suite by what is stored of them.

    Attributes:
        done: with the present code, and its result is valid or the estimator had declined.
        failed: with the present code.
        stale: with former code or parameters only.
        missing: not at all.
    """

    done: list[Trial]
    failed: list[Trial]
    stale: list[Trial]
    missing: list[Trial]


def progress(trials: Iterable[Trial], records: Iterable[Record]) -> Progress:
    """Sort trials by what is stored of them."""
    stored: dict[tuple[str, ...], dict[object, str]] = {}
    for record in records:
        *place, parameters = record.key
        stored.setdefault(tuple(place), {})[parameters, record.versions] = record.status
    sorted_out = Progress([], [], [], [])
    for trial in trials:
        *place, parameters = trial.key
        found = stored.get(tuple(place), {})
        status = found.get((parameters, trial.versions))
        if status is None:
            (sorted_out.stale if found else sorted_out.missing).append(trial)
        else:
            (sorted_out.done if status in ("ok", "skipped") else sorted_out.failed).append(trial)
    return sorted_out


def pending(
    trials: Iterable[Trial], records: Iterable[Record], retry: Collection[str] = ()
) -> list[Trial]:
    """Trials that have no row with the present code, or one that is to be tried again.

    Args:
        trials: what is to be done.
        records: what is stored.
        retry: some of ``RETRIES``.
    """
    finished = {
        (record.key, record.versions)
        for record in records
        if not (record.status in retry or ("failed" in retry and record.status in RETRIES))
    }
    return [trial for trial in trials if (trial.key, trial.versions) not in finished]


def last_suite(runs: Sequence[Provenance], place: object) -> Suite:
    """The suite of the latest of the runs in a place.

    Raises:
        UserError: if there is none.
    """
    if not runs:
        raise UserError(f"the run in {place} was written by a version that noted no suite")
    return read_suite_json(runs[-1].suite)


def check_same_suite(
    suite: Suite, runs: Iterable[Provenance], place: object, instead: str = "use another --out"
) -> None:
    """Refuse to go on where the suite has changed in a way that would mix two studies.

    A suite may gain scenarios, views, noise levels and estimators.

    Args:
        suite: the present one.
        runs: former ones.
        place: where they are.
        instead: what else could be done.

    Raises:
        UserError: if it differs in anything else from that of a former run, with the difference.
    """
    for run in runs:
        former = read_suite_json(run.suite)
        if former.name != suite.name:
            raise UserError(
                f"{place} holds a run of suite {former.name!r}, not {suite.name!r}; {instead}"
            )
        difference = _difference(former, suite)
        if difference is not None:
            raise UserError(
                f"suite {suite.name!r} has changed since the run in {place} of {run.started}: "
                f"{difference}; rows of both would be mixed: {instead}, or take the change back"
            )


def _difference(former: Suite, suite: Suite) -> str | None:
    for name in ("seeds", "time_limit", "root_iterations"):
        old, new = getattr(former, name), getattr(suite, name)
        if old != new:
            return f"{name} was {old} and is {new}"
    for name in ("scenarios", "views", "sigmas"):
        new_items = getattr(suite, name)
        gone = [item for item in getattr(former, name) if item not in new_items]
        if gone:
            return f"{name} had {getattr(gone[0], 'label', gone[0])} and has it no more"
    return None

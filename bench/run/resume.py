"""Which trials of a suite are done already, and whether a run may continue another one."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import cached_property

from olne_bench.bench.plan.outcome import FAILURES
from olne_bench.bench.plan.salt import salt_id
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import KEY_COLUMNS, Trial
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.store import Record
from olne_bench.errors import UserError

#: Values of ``--retry``: all failures of estimators, one kind of them, or errors of the harness.
RETRIES = ("failed", *FAILURES, "harness_error")

#: States of a trial: a valid result, or declined by the estimator; a failed attempt; an error of
#: the harness; only rows of other code or parameters; no row.
STATES = ("done", "failed", "harness_error", "stale", "missing")

_PLACE = [k for k, name in enumerate(KEY_COLUMNS) if name != "parameters"]


class Stored:
    """The stored status of trials."""

    def __init__(self, records: Iterable[Record]) -> None:
        self._statuses = {(record.key, record.versions): record.status for record in records}

    def status(self, trial: Trial) -> str | None:
        """The status of a trial with the present code; None if it has no row."""
        return self._statuses.get((trial.key, trial.versions)) if self._statuses else None

    def state(self, trial: Trial) -> str:
        """The state of a trial, one of ``STATES``."""
        status = self.status(trial)
        if status is None:
            return "stale" if _place(trial.key) in self._places else "missing"
        if status == "harness_error":
            return status
        return "failed" if status in FAILURES else "done"

    @cached_property
    def _places(self) -> set[tuple[str, ...]]:
        return {_place(key) for key, _ in self._statuses}


def _place(key: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(key[k] for k in _PLACE)


def pending(
    trials: Iterable[Trial], stored: Stored, retry: Collection[str] = ()
) -> Iterator[Trial]:
    """Trials without a row of the present code, and trials to run again.

    Args:
        trials: trials to run.
        stored: status of stored trials.
        retry: some of ``RETRIES``.
    """
    again = {*retry, *(FAILURES if "failed" in retry else ())}
    for trial in trials:
        status = stored.status(trial)
        if status is None or status in again:
            yield trial


def last_suite(runs: Sequence[Provenance], place: object) -> Suite:
    """The suite of the latest run in a place.

    Raises:
        UserError: if there is none.
    """
    if not runs:
        raise UserError(f"the run in {place} was written by a version that noted no suite")
    return read_suite_json(runs[-1].suite)


def check_same_suite(
    suite: Suite, runs: Iterable[Provenance], place: object, instead: str = "use another --out"
) -> None:
    """Refuse to continue if the suite has changed so that two studies would be mixed.

    A suite may gain scenarios, sensors, noise levels and estimators. Another metric makes all
    rows stale.

    Args:
        suite: the present suite.
        runs: former runs.
        place: where the runs are.
        instead: advice in the error message.

    Raises:
        UserError: if anything else differs from the suite of a former run; the message names it.
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
    if former.salt != suite.salt:
        return f"its salt was {salt_id(former.salt)} and is {salt_id(suite.salt)}"
    for name in ("scenarios", "sensors", "sigmas"):
        new_items = getattr(suite, name)
        gone = [item for item in getattr(former, name) if item not in new_items]
        if gone:
            return f"{name} had {getattr(gone[0], 'label', gone[0])} and has it no more"
    return None

"""Which trials of a suite are done already, and whether a run may continue another one."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from olne_bench.bench.plan.kinds import Rules, StudyKind
from olne_bench.bench.plan.outcome import FAILURES
from olne_bench.bench.plan.suite import Suite, read_suite_json, salt_id
from olne_bench.bench.plan.trial import CELL_COLUMNS, Trial
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.store import Records, read_store
from olne_bench.errors import UserError

#: States of a trial: a valid result, or declined by the estimator; a failed attempt; an error of
#: the harness; only rows of other code or parameters; no row.
STATES = ("done", "failed", "harness_error", "stale", "missing")


class Stored:
    """The stored status of trials."""

    def __init__(self, records: Records) -> None:
        self._cells: dict[tuple[Any, ...], dict[tuple[Any, ...], dict[int, str]]] = {}
        width = len(CELL_COLUMNS)
        for group, statuses in records.items():
            self._cells.setdefault(group[:width], {})[group[width:]] = statuses

    def status(self, trial: Trial) -> str | None:
        """The status of a trial with the present code; None if it has no row."""
        return self._cells.get(trial.cell, {}).get(trial.code, {}).get(trial.seed)

    def state(self, trial: Trial) -> str:
        """The state of a trial, one of ``STATES``."""
        (found,) = self.states(trial, (trial.seed,))
        return found

    def states(self, trial: Trial, seeds: Iterable[int]) -> Counter[str]:
        """How many trials that differ in nothing but the seed are in each of ``STATES``."""
        by_code = self._cells.get(trial.cell, {})
        own = by_code.get(trial.code, {})
        statuses = Counter(map(own.get, seeds))
        found = Counter[str]()
        for status, number in statuses.items():
            if status is not None:
                found[_state(status)] += number
        if statuses[None]:
            former = set[int]().union(*by_code.values())
            found["stale"] = sum(seed in former for seed in seeds if seed not in own)
            found["missing"] = statuses[None] - found["stale"]
        return +found


def _state(status: str) -> str:
    if status == "harness_error":
        return status
    return "failed" if status in FAILURES else "done"


def pending(
    trials: Iterable[Trial], stored: Stored, retry: Collection[str] = ()
) -> Iterator[Trial]:
    """Trials without a row of the present code, and trials to run again.

    Args:
        trials: trials to run.
        stored: status of stored trials.
        retry: some of ``outcome.RETRIES``.
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


def kind_of(folder: Path) -> StudyKind:
    """The kind of the study in a run folder.

    Raises:
        UserError: if there is no run.
    """
    with read_store(folder) as store:
        return last_suite(store.runs(), folder).kind


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
    for name in ("kind", "seeds", "time_limit", "root_iterations"):
        old, new = getattr(former, name), getattr(suite, name)
        if old != new:
            return f"{name} was {old} and is {new}"
    for name in Rules.model_fields:
        old, new = getattr(former.rules, name), getattr(suite.rules, name)
        if old != new and not (name == "fit_every" and old is None):  # fits may come later
            old, new = ("the default" if one is None else one for one in (old, new))
            return f"its rule {name} was {old} and is {new}"
    if former.salt != suite.salt:
        return f"its salt was {salt_id(former.salt)} and is {salt_id(suite.salt)}"
    for name in ("scenarios", "sensors", "sigmas"):
        new_items = getattr(suite, name)
        gone = [item for item in getattr(former, name) if item not in new_items]
        if gone:
            return f"{name} had {getattr(gone[0], 'label', gone[0])} and has it no more"
    return None

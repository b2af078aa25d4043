"""Run trials of a submission again, as a run does, and compare them with their rows."""

from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, field, replace

from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.submission.fresh_draws import Machine, run_all
from olne_bench.bench.submission.rows import Key, Rows, described, difference

#: A machine may be slower than another one by this factor. A trial that reached its time limit is
#: tried once more with so many times the limit, on its own.
SLOWER = 4
#: So many trials that reach their limit here, and did not before, are looked into at once.
_LATE = 3
#: So many rows that reached their limit are no reason to refuse.
_FEW_SILENT = 3
_TIMEOUT = "timeout"


@dataclass
class Repeated:
    """Rows and their trials run again."""

    same: int = 0
    differing: list[str] = field(default_factory=list)  # one line each
    silent: int = 0  # rows that say nothing: they reached a time limit there, and nearly here

    @property
    def total(self) -> int:
        """Number of rows that were run again."""
        return self.same + len(self.differing) + self.silent

    @property
    def too_silent(self) -> bool:
        """Whether so many rows say nothing that they may hide what rivals can do."""
        return self.silent > max(_FEW_SILENT, self.total // 10)


def repeat(trials: Iterable[Trial], rows: Rows, machine: Machine, *, exact: bool) -> Repeated:
    """Run trials again and compare them with their rows.

    Those that do not end here, although their rows say that they did, are run again with a longer
    limit. If one does not end then either, no more are run: the submission is refused.
    """
    found = Repeated()
    left = list(trials)
    while left:
        done: set[Key] = set()
        late: list[Trial] = []
        with closing(run_all(left, machine)) as ended:
            for trial, outcome in ended:
                done.add(trial.key)
                if outcome.status == _TIMEOUT != rows.row(trial.key)["status"]:
                    late.append(trial)
                else:
                    _note(found, trial, outcome, rows, exact=exact)
                if len(late) == _LATE:
                    break
        if not _in_time(late, found, rows, machine, exact=exact):
            return found
        left = [trial for trial in left if trial.key not in done]
    return found


def _in_time(
    late: list[Trial], found: Repeated, rows: Rows, machine: Machine, *, exact: bool
) -> bool:
    """Whether trials end with a longer limit, one by one."""
    longer = [replace(trial, time_limit=SLOWER * trial.time_limit) for trial in late]
    with closing(run_all(longer, replace(machine, jobs=1))) as ended:
        for trial, outcome in ended:
            _note(found, trial, outcome, rows, exact=exact)
            if outcome.status == _TIMEOUT:
                return False
    return True


def _note(found: Repeated, trial: Trial, outcome: Outcome, rows: Rows, *, exact: bool) -> None:
    row = rows.row(trial.key)
    seconds = outcome.trial_seconds or outcome.solve_seconds or 0.0
    if row["status"] == _TIMEOUT != outcome.status and SLOWER * seconds > trial.time_limit:
        found.silent += 1
        return
    said = difference(row, outcome, exact=exact)
    if said is None:
        found.same += 1
        return
    limits = f" (after {seconds:.3g} s; limit {trial.time_limit:g} s)"
    about = limits if _TIMEOUT in (row["status"], outcome.status) else ""
    found.differing.append(f"{described(row)}: {said}{about}")


def outcomes_of(trials: Iterable[Trial], machine: Machine) -> dict[Key, Outcome]:
    """Run trials, each once."""
    distinct = {trial.key: trial for trial in trials}
    return {trial.key: outcome for trial, outcome in run_all(distinct.values(), machine)}

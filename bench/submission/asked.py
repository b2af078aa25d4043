"""The trials that a submission's runs were asked for: counted before they are listed."""

from functools import partial
from pathlib import Path

from olne_bench.bench.plan.draws import draws_source
from olne_bench.bench.plan.learn import learn
from olne_bench.bench.plan.load import check_suite, load_suite, suite_names
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import Trial, in_order_of_plugins, number_of_trials
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.bench.submission.manifest import Submission
from olne_bench.bench.submission.rows import Key
from olne_bench.errors import UserError

#: Largest number of different suites, selections and numbers of seeds of a submission's runs.
_MOST = 20
#: What a suite of this package fixes.
_FIXED = ("sigmas", "seeds", "time_limit", "root_iterations", "trajectories")
_LISTED = ("scenarios", "sensors", "estimators")

_Asked = tuple[Suite, Selection, int]


def asked(submission: Submission, home: Path, rows: int) -> list[_Asked]:
    """What the runs were asked for: suite, selection and number of seeds, each once.

    ``home`` has its plugins. UserError if a suite cannot run here, or asks for more than ``rows``.
    """
    found: dict[tuple[str, str, int], _Asked] = {}
    for run, suite in zip(submission.runs, submission.suites(home), strict=True):
        key = (run.suite, str(run.selection), run.seeds)
        found.setdefault(key, (suite, run.selection, run.seeds))
    if len(found) > _MOST:
        raise UserError(f"{submission.folder}: its runs are of {len(found)} kinds, at most {_MOST}")
    try:
        for suite, selection, seeds in found.values():
            _check_number(select(suite, selection), seeds, rows)
        whole = [(_learnt(s, submission.folder), chosen, n) for s, chosen, n in found.values()]
        for suite, selection, seeds in whole:
            _check_number(select(suite, selection), seeds, rows)
            check_shipped(suite)
    except UserError as error:
        raise UserError(f"{submission.folder}: {error}") from error
    return whole


def planned_trials(parts: list[_Asked]) -> dict[Key, Trial]:
    """All trials of ``asked``, in an order in which they run fast; their truths as in a run."""
    trials: dict[Key, Trial] = {}
    for suite, selection, seeds in parts:
        known = suite.origin in suite_names()
        draws = draws_source(suite.origin, suite) if known else None
        for trial in in_order_of_plugins(select(suite, selection), seeds, draws):
            trials.setdefault(trial.key, trial)
    return trials


def _check_number(part: Suite, seeds: int, rows: int) -> None:
    number = number_of_trials(part, seeds)
    if number > rows:
        raise UserError(f"suite {part.name!r} asks for {number} trials, and there are {rows} rows")


def _learnt(suite: Suite, folder: Path) -> Suite:
    """The suite with the present descriptions of its plugins instead of the stored ones."""
    found = learn(suite, (), partial(describe_all, hidden=folder))
    check_suite(found)
    return found


def check_shipped(suite: Suite) -> None:
    """Refuse a suite that is called as one of this package, and is another one.

    It may have more estimators, or fewer, and another salt.
    """
    if suite.name not in suite_names():
        return
    shipped = load_suite(suite.name)
    differs = [name for name in _FIXED if getattr(suite, name) != getattr(shipped, name)]
    for kind in _LISTED:
        known = {entry.label: entry for entry in getattr(shipped, kind)}
        for entry in getattr(suite, kind):
            usual = known.get(entry.label)
            if usual != entry and (usual is not None or kind != "estimators"):
                differs.append(f"{kind[:-1]} {entry.label!r}")
    if differs:
        raise UserError(
            f"it is not the suite {suite.name!r} of this version, and has its name: "
            f"see {', '.join(differs[:3])}"
        )

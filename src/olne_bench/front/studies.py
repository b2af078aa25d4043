"""Run a study from Python, and read one."""

import threading
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from olne_bench import plugins as registry
from olne_bench.bench.plan.outcome import FAILURES, RETRIES
from olne_bench.bench.plan.select import Selection
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.report.leaderboard import leaderboard
from olne_bench.bench.report.study import study_of
from olne_bench.bench.run.executor import never
from olne_bench.bench.run.interrupt import StopRequest, stop_request
from olne_bench.bench.run.resume import last_suite
from olne_bench.bench.run.store import open_store, read_store
from olne_bench.bench.run.study import Machine, Wanted, begin, load_study, run_stored
from olne_bench.checks import is_whole
from olne_bench.errors import UserError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class StudyRun:
    """A run folder.

    Attributes:
        folder: where it is.
    """

    folder: Path

    @cached_property
    def trials(self) -> "pd.DataFrame":
        """One row per trial: what was run, its status, and its scores (``docs/statistics.md``)."""
        with read_store(self.folder) as store:
            return store.frame()

    @cached_property
    def suites(self) -> list[Suite]:
        """The suite of each run in the folder; the last one has all of it."""
        with read_store(self.folder) as store:
            runs = store.runs()
        last_suite(runs, self.folder)  # refuses a folder that notes none
        return [read_suite_json(run.suite) for run in runs]

    @property
    def leaderboard(self) -> "pd.DataFrame":
        """One row per scenario, sensor and estimator; a failure counts as infinitely wrong.

        ``olne-bench report`` adds scores, which compare estimators at equal data.
        """
        return leaderboard(self.trials, study=study_of(self.suites))

    def __repr__(self) -> str:
        """One line: where it is, and how many of its trials failed."""
        failed = int(self.trials["status"].isin(FAILURES).sum())
        name = self.suites[-1].name
        rows = f"{len(self.trials)} rows, {failed} failed"
        return f"StudyRun({str(self.folder)!r}: suite {name!r}, {rows})"


def read(folder: str | Path) -> StudyRun:
    """The study in a run folder, as ``olne-bench run`` or ``run`` has left it.

    Raises:
        UserError: if there is no run in the folder.
    """
    found = StudyRun(Path(folder))
    if found.trials.empty:
        raise UserError(f"the run in {folder} has no finished trial yet")
    return found


def run(
    suite: str,
    *,
    out: str | Path,
    scenarios: str | Sequence[str] = (),
    sensors: str | Sequence[str] = (),
    estimators: str | Sequence[str] = (),
    sigma: float | Sequence[float] = (),
    seeds: int | None = None,
    plugins: str | Sequence[str] = (),
    salt: str | None = None,
    retry: str | Sequence[str] = (),
    jobs: int = 2,
    memory: float = 4.0,
    dask: str | None = None,
) -> StudyRun:
    """Run a suite, or continue an interrupted run, as ``olne-bench run`` does.

    Estimators run in processes of their own, which do not know the truth. What the suite does not
    have replaces what it has; the changed suite has another name.

    Args:
        suite: name or TOML file of the suite.
        out: run folder; trials that it holds are not run again.
        scenarios: names, to select or to replace those of the suite.
        sensors: the same.
        estimators: the same.
        sigma: noise levels, on roads standard deviations of positions [m].
        seeds: number of draws to use, from the first on. Default: all.
        plugins: files ``path.py:Class`` to add to the suite.
        salt: text that seeds noise and draws; ``"fresh"`` draws a secret one.
        retry: ``"failed"`` or a status: trials to run again.
        jobs: number of trials at the same time.
        memory: memory limit of each worker process [GiB].
        dask: address of a Dask cluster.

    Raises:
        UserError: on whatever cannot be run, in one line.
        TypeError: on names that are no texts.
        KeyboardInterrupt: after Ctrl-C; finished trials are stored.
    """
    chosen = Selection.model_construct(
        scenarios=_texts("scenarios", scenarios),
        sensors=_texts("sensors", sensors),
        sigmas=tuple(map(float, sigma if isinstance(sigma, Iterable) else (sigma,))),
        estimators=_texts("estimators", estimators),
        seeds=_checked(seeds),
    )
    wanted = Wanted(str(suite), chosen, _texts("plugins", plugins), salt, _retried(retry))
    return _run(wanted, Machine(Path(out), jobs, dask, memory))


def _run(wanted: Wanted, machine: Machine) -> StudyRun:
    with registry.loading():
        whole = load_study(wanted, machine)
        with open_store(machine.out) as store:
            todo, stored = begin(whole, wanted, machine, store), 0
            with _stopping() as stop:
                for _ in run_stored(todo.trials, machine, store, stop or never):
                    stored += 1
    if stop is not None and stop.signal is not None and stored < todo.number:
        raise KeyboardInterrupt(f"{stored} trials are stored, {todo.number - stored} remain")
    return read(machine.out)


def _checked(seeds: int | None) -> int | None:
    if seeds is not None and (not is_whole(seeds) or seeds < 1):
        raise UserError(f"seeds must be a whole number of at least 1, got {seeds!r}")
    return seeds


def _retried(given: str | Sequence[str]) -> tuple[str, ...]:
    for one in _texts("retry", given):
        if one not in RETRIES:
            raise UserError(f"retry {one!r}: known are {', '.join(RETRIES)}")
    return _texts("retry", given)


def _stopping() -> AbstractContextManager[StopRequest | None]:
    """Handles Ctrl-C in the main thread; Python lets no other thread do it."""
    main = threading.current_thread() is threading.main_thread()
    return stop_request() if main else nullcontext()


def _texts(name: str, given: str | Sequence[str]) -> tuple[str, ...]:
    listed = (given,) if isinstance(given, str) or not isinstance(given, Sequence) else given
    for one in listed:
        if not isinstance(one, str):
            raise TypeError(
                f"{name} must be names, got {one!r}: a study runs them in other processes; name "
                "the file of a class with plugins, or use olne_bench.compare"
            )
    return tuple(listed)

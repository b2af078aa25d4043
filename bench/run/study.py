"""Run what the store of a study lacks, and say nothing: who asks may show it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from olne_bench.bench.plan.draws import draws_path, draws_source
from olne_bench.bench.plan.kinds import StudyKind
from olne_bench.bench.plan.learn import Question
from olne_bench.bench.plan.load import check_gate, load_suite, suite_text
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.select import Selection, changed, joined, select
from olne_bench.bench.plan.suite import Suite, check_salt, read_suite_json, salted
from olne_bench.bench.plan.trial import Trial, in_order_of_plugins, number_of_trials
from olne_bench.bench.process import nursery
from olne_bench.bench.run.check_study import check_fit, check_kind, check_priors
from olne_bench.bench.run.cluster import check_cluster, run_on_dask
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.bench.run.executor import run_trials
from olne_bench.bench.run.provenance import provenance
from olne_bench.bench.run.resume import Stored, check_same_suite, pending
from olne_bench.bench.run.store import Store
from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.plugins import Description, is_built_in, source

#: What plays these roads, whose import takes a second.
_SIMULATOR = "olne_bench.envs.roads.simulated_roads"
#: File in the run folder for what estimators print.
LOG = "workers.log"


@dataclass(frozen=True)
class Machine:
    """Where a study runs, and into which folder.

    Attributes:
        out: run folder.
        jobs: number of trials at the same time.
        dask: address of a cluster; None for processes here.
        memory: memory limit of each worker process [GiB].
    """

    out: Path
    jobs: int = 2
    dask: str | None = None
    memory: float = 4.0

    @property
    def executor(self) -> str:
        """Where trials run, for the provenance."""
        return f"dask {self.dask}" if self.dask else f"{self.jobs} local processes"


@dataclass(frozen=True)
class Wanted:
    """What is asked of a study.

    Attributes:
        suite: name or TOML file of the suite.
        selection: part of it.
        plugins: references of plugins to add to it.
        salt: text that seeds noise and draws; None for that of the suite.
        retry: failed trials to run again, some of ``outcome.RETRIES``.
        kind: kind of study to make of the suite; None for its own.
        rules: rules that replace its own.
    """

    suite: str
    selection: Selection
    plugins: tuple[str, ...] = ()
    salt: str | None = None
    retry: tuple[str, ...] = ()
    kind: StudyKind | None = None
    rules: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Todo:
    """What is left of a study.

    Attributes:
        trials: trials to run, read lazily.
        number: how many they are.
        total: how many trials the study has in all.
        draws: file of solved draws that is used, if any.
    """

    trials: Iterable[Trial]
    number: int
    total: int
    draws: Path | None


def load_study(wanted: Wanted, machine: Machine) -> Suite:
    """The whole suite of a study, changed by the selection. Nothing is written.

    Raises:
        UserError: on whatever cannot be run.
    """
    check_salt(wanted.salt)
    describe = partial(_described, machine.out)
    suite = load_suite(wanted.suite, wanted.plugins, describe, wanted.kind, wanted.rules)
    check_gate(suite)
    whole = changed(suite, wanted.selection, describe)
    draws_source(wanted.suite, whole)
    part = select(whole, wanted.selection)
    check_kind(part)
    check_fit(part, machine.out)
    check_priors(part, machine.out)
    if machine.dask is not None:
        check_cluster(machine.dask)
    return whole


def _described(hidden: Path, questions: list[Question]) -> list[Description]:
    """Describe plugins, while built-in ones are imported where they will run."""
    built_in = [(kind, name) for kind, name, _ in questions if kind and is_built_in(kind, name)]
    named = (one for _, name, given in questions for one in (name, *given.values()))
    simulators = [_SIMULATOR] if any(one in ROAD_NAMES for one in named) else []
    nursery.meanwhile([*(source(kind, name)[0] for kind, name in built_in), *simulators])
    return describe_all(questions, hidden)


def begin(suite: Suite, wanted: Wanted, machine: Machine, store: Store) -> Todo:
    """Note a run in the store of a study, and find what the store lacks.

    Args:
        suite: the whole suite.
        wanted: what is asked of it.
        machine: where it runs.
        store: where outcomes go.

    Raises:
        UserError: if the suite does not fit the one that the store was begun with.
    """
    runs, seeds = store.runs(), wanted.selection.seeds
    former = read_suite_json(runs[-1].suite) if runs else None
    suite = salted(joined(suite, wanted.selection, former), wanted.salt, former)
    check_same_suite(suite, runs, machine.out)
    part = select(suite, wanted.selection)
    draws = draws_source(wanted.suite, suite)
    store.check()  # before trials are run beside damaged rows
    stored, total = Stored(store.records()), number_of_trials(part, seeds)

    def todo() -> Iterator[Trial]:
        # A process that ran foreign code serves nothing else: this order needs few processes.
        return pending(in_order_of_plugins(part, seeds, draws), stored, wanted.retry)

    number = sum(1 for _ in todo()) if runs else total
    source = provenance(
        suite=suite.model_dump_json(),
        suite_text=suite_text(wanted.suite),
        selection=wanted.selection,
        seeds=seeds or suite.seeds,
        executor=machine.executor,
    )
    store.begin_run(source, in_order_of_plugins(part, 1))
    return Todo(todo(), number, total, draws_path(wanted.suite) if draws else None)


def run_stored(
    todo: Iterable[Trial], machine: Machine, store: Store, stop: Callable[[], bool]
) -> Iterator[Outcome]:
    """Run trials, here or on a cluster; yield each outcome once it is stored."""
    limit, out = int(machine.memory * 2**30), machine.out.resolve()
    given: dict[str, Any] = {"log": out / LOG, "memory": limit, "hidden": out, "stop": stop}
    if machine.dask:
        ended = run_on_dask(todo, cluster=machine.dask, **given)
    else:
        ended = run_trials(todo, jobs=machine.jobs, **given)
    for trial, outcome in ended:
        store.add(trial, outcome)
        yield outcome

"""Whether estimators of foreign code can be imported and made, found out in another process.

This process needs their classes too, but must not be the first to run what may hang or die.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from olne_bench.bench.judge.referee import describe_error
from olne_bench.bench.plan.learn import Question, describe_here
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.run.referee_process import WorkerProcess
from olne_bench.errors import UserError
from olne_bench.plugins import ESTIMATOR, Description, is_built_in, make

#: Seconds that importing and making one estimator may take.
LOAD_LIMIT = 60.0


@dataclass(frozen=True)
class Loading:
    """One estimator to be made.

    Attributes:
        reference: of the estimator.
        parameters: of its class.
        time_limit: wall-clock seconds.
    """

    reference: str
    parameters: Mapping[str, Any]
    time_limit: float

    @property
    def plugin(self) -> str:
        """Its file, or its name: classes of one file share a process."""
        return self.reference.partition(".py:")[0]


def probe(estimators: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
    """Make estimators in a process that may die of it; those that are built in are not tried.

    Args:
        estimators: references and parameters.

    Raises:
        UserError: with one line on the first that cannot be made.
    """
    worker: WorkerProcess[Loading] = WorkerProcess(load, log=Path(os.devnull), memory=None)
    try:
        for reference, parameters in estimators:
            if is_built_in(ESTIMATOR, reference):
                continue
            worker.assign(Loading(reference, parameters, LOAD_LIMIT))
            outcome = worker.wait()
            if outcome.status != "ok":
                raise UserError(f"estimator {reference!r} cannot be loaded: {outcome.message}")
    finally:
        worker.stop()


def load(task: Loading, begin: Callable[[str], None]) -> Outcome:
    """Make an estimator in this process.

    Raises:
        PluginError: as ``plugins.make`` does.
    """
    begin("its import")
    try:
        make(ESTIMATOR, task.reference, task.parameters)
    except (KeyboardInterrupt, GeneratorExit) as error:  # raised by it: nobody else can, here
        return Outcome("crash", describe_error(error))
    return Outcome("ok")


def describe_apart(questions: list[Question]) -> list[Description]:
    """What plugins say of themselves, once a process that may die of it has tried them."""
    foreign = [
        (reference, parameters)
        for kind, reference, parameters in questions
        if kind in (None, ESTIMATOR) and not is_built_in(ESTIMATOR, reference)
    ]
    probe(foreign)
    return describe_here(questions)

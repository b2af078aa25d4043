"""Foreign metrics, each in its own process, so that it cannot affect anything else."""

import pickle
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from olne_bench import plugins
from olne_bench.bench.judge.metrics.judged import HeldOut, Judged
from olne_bench.bench.judge.metrics.scoring import MetricError, score_all
from olne_bench.bench.plan.entries import MetricEntry
from olne_bench.bench.process.child import Child, ChildError, RaisedError
from olne_bench.bench.process.messages import StartError
from olne_bench.errors import UserError


class Score(msgspec.Struct):
    """The score of a trial; None if the metric does not apply."""

    value: float | None


class MetricProcess:
    """The processes of a run's foreign metrics."""

    def __init__(self, *, memory: int | None, hidden: Path | None) -> None:
        """Nothing is started yet; arguments as in ``PlayerProcess``."""
        self._memory, self._hidden = memory, hidden
        self._children: dict[str, Child] = {}

    def score(
        self, metric: MetricEntry, case: Judged, homes: Sequence[str], seconds: float
    ) -> float | None:
        """The score of a trial; None if the metric does not apply.

        Args:
            metric: its entry in the suite.
            case: what is scored.
            homes: files of plugins whose classes the case contains.
            seconds: time that it may take [s].

        Raises:
            MetricError: if the metric fails or returns no valid score.
        """
        known = metric.model_dump_json()
        child = self._children.get(known)
        if child is None:
            child = Child(
                memory=self._memory,
                restricted=True,
                plugins=[metric.name, *homes],
                hidden=self._hidden,
            )
            self._children[known] = child
        # The metric's process gets the held-out predictions, not the code that computes them.
        plain = replace(case, held_out=partial(_known, case.held_out()))
        call = (metric.name, metric.parameters, tuple(homes), pickle.dumps(plain))
        try:
            found: Score = child.call(score, *call, kind=Score, seconds=seconds)
        except StartError:
            raise
        except (ChildError, RaisedError, UserError) as error:
            kind = type(error).__name__.removesuffix("Error")
            raise MetricError(f"metric {metric.column!r}: {error or kind}") from error
        return found.value

    def stop(self) -> None:
        """Kill the processes and all their descendants."""
        for child in self._children.values():
            child.stop()
        self._children.clear()


def score(reference: str, parameters: dict[str, Any], homes: Sequence[str], case: bytes) -> Score:
    """Score a trial in this process; arguments as in ``MetricProcess.score``."""
    for home in homes:
        plugins.import_file(home)
    metric: Any = plugins.make(plugins.METRIC, reference, parameters)
    with plugins.at_home(metric):
        (value,) = score_all([metric], pickle.loads(case)).values()
    return Score(value)


def _known(held_out: tuple[HeldOut, ...] | None) -> tuple[HeldOut, ...] | None:
    return held_out

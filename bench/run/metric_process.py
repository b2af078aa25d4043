"""Metrics of foreign code, each in a process of its own: what it changes there stays there."""

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
from olne_bench.bench.process.child import Child, ChildError, RaisedError, StartError
from olne_bench.errors import UserError


class Score(msgspec.Struct):
    """What a metric says of a trial."""

    value: float | None


class MetricProcess:
    """The processes of a run's foreign metrics."""

    def __init__(self, *, memory: int | None, hidden: Path | None) -> None:
        """Nothing is started yet; arguments as of ``PlayerProcess``."""
        self._memory, self._hidden = memory, hidden
        self._children: dict[str, Child] = {}

    def score(
        self, metric: MetricEntry, case: Judged, homes: Sequence[str], seconds: float
    ) -> float | None:
        """What a metric says of a trial.

        Args:
            metric: its entry in the suite.
            case: what is scored.
            homes: files of plugins whose classes the case is made of.
            seconds: that it may take.

        Raises:
            MetricError: where it says nothing that could be kept.
        """
        known = metric.model_dump_json()
        child = self._children.get(known)
        if child is None:
            child = Child(memory=self._memory, restricted=True, hidden=self._hidden)
            self._children[known] = child
        # What works out held-out predictions stays here; the predictions go.
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
        """Kill the processes with all that they started."""
        for child in self._children.values():
            child.stop()
        self._children.clear()


def score(reference: str, parameters: dict[str, Any], homes: Sequence[str], case: bytes) -> Score:
    """Score a trial in this process; arguments as of ``MetricProcess.score``."""
    for home in homes:
        plugins.import_file(home)
    metric: Any = plugins.make(plugins.METRIC, reference, parameters)
    with plugins.at_home(metric):
        (value,) = score_all([metric], pickle.loads(case)).values()
    return Score(value)


def _known(held_out: tuple[HeldOut, ...] | None) -> tuple[HeldOut, ...] | None:
    return held_out

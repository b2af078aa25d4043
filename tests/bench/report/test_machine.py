"""Trials of a check are run as a run does it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.report import machine
from olne_bench.bench.report.machine import Machine, run_all
from olne_bench.bench.run.study import LOG


def test_trials_run_in_places_that_are_named_as_those_of_a_run(monkeypatch) -> None:
    asked: dict[str, Any] = {}

    def run_trials(some: Any, **options: Any) -> Iterator[tuple[Trial, Outcome]]:
        asked.update(options)
        for trial in some:
            yield trial, Outcome("ok")

    monkeypatch.setattr(machine, "run_trials", run_trials)
    trials = list(expand(load_suite("quick"), 1))[:3]
    found = run_all(trials, Machine(jobs=4, memory=2**30, hidden=Path("/hidden")))
    assert [trial for trial, _ in found] == trials
    assert asked.pop("log").name == LOG
    assert asked == {"jobs": 4, "memory": 2**30, "hidden": Path("/hidden")}

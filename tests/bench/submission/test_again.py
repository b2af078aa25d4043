"""Rows run again: compared, and what does not end here is looked into."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.submission import again
from olne_bench.bench.submission.again import SLOWER, Repeated, outcomes_of, repeat
from olne_bench.bench.submission.fresh_draws import Machine

MACHINE = Machine(jobs=4, memory=2**30, hidden=Path("/hidden"))
OK = Outcome("ok", solve_seconds=0.1, scores={"position_error": 0.5}, trial_seconds=0.2)
LATE = Outcome("timeout", trial_seconds=60.0)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return [t for t in expand(load_suite("quick"), 2) if t.sigma == 0.05]


class Stored:
    """Rows that say what they are told."""

    def __init__(self, **rows: Any) -> None:
        self.usual = rows

    def row(self, key: tuple[str, ...]) -> dict[str, Any]:
        labels = {"estimator": key[5], "scenario": key[0], "sensor": key[1]}
        about = {"sigma": key[2], "seed": key[3], "solve_seconds": 3.0}
        return labels | about | {"status": "ok", "position_error": 0.5} | self.usual


Play = Callable[[Trial, Machine], Outcome]


@pytest.fixture
def run(monkeypatch) -> Callable[..., tuple[Repeated, list[tuple[Trial, Machine]]]]:
    """Repeat trials whose outcomes are made up."""

    def call(trials: list[Trial], play: Play, **rows: Any) -> Any:
        played: list[tuple[Trial, Machine]] = []

        def run_all(some: Any, machine: Machine) -> Iterator[tuple[Trial, Outcome]]:
            for trial in some:
                played.append((trial, machine))
                yield trial, play(trial, machine)

        monkeypatch.setattr(again, "run_all", run_all)
        stored: Any = Stored(**rows)
        return repeat(trials, stored, MACHINE, exact=True), played

    return call


def test_rows_that_are_the_same_are_counted(run, trials) -> None:
    found, played = run(trials, lambda *_: OK)
    assert (found.same, found.differing, found.silent) == (len(trials), [], 0)
    assert found.total == len(trials) == len(played)
    found, _ = run(trials, lambda *_: OK, position_error=0.25)
    assert found.same == 0
    assert len(found.differing) == len(trials)
    assert "position_error is 0.25 in the submission and 0.5 here" in found.differing[0]


def test_a_row_that_is_ok_there_and_never_ends_here_differs(run, trials) -> None:
    found, played = run(trials, lambda *_: LATE)
    assert len(found.differing) == 1
    assert found.differing[0].endswith(
        "status is ok in the submission and timeout here (after 60 s; limit 240 s)"
    )
    assert len(played) == 3 + 1  # no more are waited for
    *_, (last, machine) = played
    assert last.time_limit == SLOWER * trials[0].time_limit
    assert machine.jobs == 1


def test_a_slow_machine_refuses_nobody(run, trials) -> None:
    def slow(trial: Trial, machine: Machine) -> Outcome:  # noqa: ARG001
        return OK if trial.time_limit > trials[0].time_limit else LATE

    found, played = run(trials, slow)
    assert (found.same, found.differing) == (len(trials), [])
    assert len(played) == 2 * len(trials)
    found, _ = run(trials, slow, position_error=0.25)
    assert len(found.differing) == len(trials)  # what ends later is compared all the same


@pytest.mark.parametrize(("seconds", "silent"), [(0.2, False), (14.0, False), (16.0, True)])
def test_a_row_that_did_not_end_there_ends_here_only_if_it_nearly_did_not(
    run, trials, seconds: float, silent: bool
) -> None:
    found, _ = run(trials[:1], lambda *_: replace(OK, trial_seconds=seconds), status="timeout")
    assert found.silent == silent
    assert len(found.differing) == (not silent)
    if not silent:
        assert f"(after {seconds:.3g} s; limit 60 s)" in found.differing[0]


def test_a_row_that_ends_nowhere_is_the_same(run, trials) -> None:
    found, played = run(trials, lambda *_: LATE, status="timeout", position_error=None)
    assert found.same == len(trials) == len(played)


def test_trials_run_once_each(monkeypatch, trials) -> None:
    monkeypatch.setattr(again, "run_all", lambda some, _: ((trial, OK) for trial in some))
    assert outcomes_of([*trials, trials[0]], MACHINE) == {trial.key: OK for trial in trials}

"""The referee as the driver sees it: whatever becomes of its process, a trial has an outcome."""

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from olne_bench.bench.judge.players import own_seconds
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.process.child import (
    ATTEMPTS,
    DiedError,
    MisspokeError,
    OutOfMemoryError,
    RaisedError,
    TimedOutError,
)
from olne_bench.bench.run import referee as referee_module
from olne_bench.bench.run.referee import RefereeProcess, run_trial
from olne_bench.errors import UserError

OK = Outcome("ok")


class FakeChild:
    """A child that answers as it is told."""

    made: list["FakeChild"]
    answers: list

    def __init__(self, **options: object) -> None:
        self.options = options
        self.sent: list[tuple] = []
        self.stage = ""
        self.stopped = 0
        self.channel = SimpleNamespace(wait=self.waited)
        self.waits: list[float] = []
        self.made.append(self)

    def waited(self, seconds: float) -> None:
        self.waits.append(seconds)

    def submit(self, function, *arguments, seconds, longest, stage):
        assert longest > seconds and stage == "set-up"
        self.sent.append((function, arguments, seconds))

    def poll(self, kind):
        assert kind is Outcome
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def stop(self):
        self.stopped += 1


@pytest.fixture
def children(monkeypatch) -> list[FakeChild]:
    """The children that were made, in order."""
    monkeypatch.setattr(referee_module, "Child", FakeChild)
    FakeChild.made, FakeChild.answers = [], []
    return FakeChild.made


@pytest.fixture(scope="module")
def trial() -> Trial:
    trial = next(expand(load_suite("quick")))
    assert trial.plugin == "" and trial.home_plugins == ()
    return trial


def foreign(trial: Trial, name: str = "mine.py:Mine") -> Trial:
    """The same trial in a foreign scenario."""
    return replace(trial, scenario=trial.scenario.model_copy(update={"name": name}))


def referee() -> RefereeProcess:
    return RefereeProcess(log=Path("log"), memory=2**30, hidden=Path("run"))


def death(outside: bool = False) -> DiedError:
    return DiedError("the process died with exit code 7", outside=outside, served=0)


def test_a_trial_is_sent_and_its_outcome_comes_back(children, trial):
    one = referee()
    one.assign(trial)
    (child,) = children
    assert child.options == {"log": Path("log"), "may_announce": True, "has_children": True}
    assert all(importlib.util.find_spec(name) for name in child.modules)
    assert "olne_bench.bench.judge.trials" in child.modules
    assert child.sent == [(run_trial, (trial, 2**30, Path("run"), False), own_seconds(trial))]
    FakeChild.answers = [None, OK]
    assert one.channel is child.channel
    assert one.poll() is None
    assert one.trial is trial
    assert one.poll() is OK
    assert one.trial is None
    one.assign(trial)
    assert len(children) == 1 and child.stopped == 0  # the same process goes on


def test_waiting_asks_until_there_is_an_outcome(children, trial):
    one = referee()
    one.assign(trial)
    FakeChild.answers = [None, None, OK]
    assert one.wait() is OK
    assert children[0].waits == [referee_module.TICK] * 2


def test_a_trial_is_tried_again_where_the_referee_died(children, trial):
    one = referee()
    for _ in range(2):  # every trial has all of its attempts
        one.assign(trial)
        FakeChild.answers = [death()] * (ATTEMPTS - 1) + [OK]
        assert [one.poll() for _ in range(ATTEMPTS)] == [None] * (ATTEMPTS - 1) + [OK]
    assert len(children[0].sent) == 2 * ATTEMPTS


@pytest.mark.parametrize("stage", ["set-up", "estimate", "scoring"])
@pytest.mark.parametrize("plugin", [False, True])
def test_a_plugin_answers_for_a_referee_that_dies_in_its_estimate(children, trial, stage, plugin):
    if plugin:
        trial = replace(trial, estimator=trial.estimator.model_copy(update={"name": "mine.py"}))
    one = referee()
    one.assign(trial)
    children[0].stage = stage
    FakeChild.answers = [death()] * ATTEMPTS
    outcome = [one.poll() for _ in range(ATTEMPTS)][-1]
    assert outcome is not None
    assert outcome.status == ("crash" if plugin and stage == "estimate" else "harness_error")
    assert "the process died with exit code 7" in outcome.message
    assert one.trial is None
    assert len(children[0].sent) == ATTEMPTS


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (TimedOutError("killed after 3 s of scoring"), "killed after 3 s of scoring"),
        (MisspokeError("spoke out of turn"), "spoke out of turn"),
        (OutOfMemoryError("too much"), "too much"),
        (RaisedError("an exception"), "an exception"),
    ],
)
def test_what_goes_wrong_is_no_estimators_fault_and_ends_the_trial(children, trial, error, said):
    one = referee()
    one.assign(trial)
    FakeChild.answers = [error]
    outcome = one.poll()
    assert outcome is not None
    assert outcome.status == "harness_error"
    assert outcome.message == said
    assert one.trial is None
    assert len(children[0].sent) == 1


def test_what_the_user_has_to_mend_ends_the_run(children, trial):
    one = referee()
    one.assign(trial)
    FakeChild.answers = [UserError("the code has changed")]
    with pytest.raises(UserError, match="the code has changed"):
        one.poll()
    assert len(children) == 1


def test_foreign_worlds_have_a_process_of_their_own_in_a_sandbox(children, trial, monkeypatch):
    checked = []
    monkeypatch.setattr(referee_module, "check_code", checked.append)
    one = referee()
    ours = one._child
    FakeChild.answers = [OK] * 5
    for played, made, restricted in (
        (trial, 1, False),
        (foreign(trial), 2, True),
        (foreign(trial), 2, True),
        (foreign(trial, "other.py:Other"), 3, True),
        (trial, 4, False),
    ):
        one.assign(played)
        assert one.poll() is OK
        assert len(children) == made
        assert children[-1].options.get("restricted", False) == restricted
    assert children[0] is ours
    # A sandbox cannot read all code, so its parent checks that. All others do so themselves.
    assert [one.home_plugins[0] for one in checked] == ["mine.py:Mine"] * 2 + ["other.py:Other"]
    assert [child.sent[-1][1][-1] for child in children] == [False, True, True, False]
    assert [child.stopped for child in children] == [1, 1, 1, 0]
    assert children[1].options == {
        "log": Path("log"),
        "memory": 2**30,
        "restricted": True,
        "plugins": ("mine.py:Mine",),
        "readable": [],
        "hidden": Path("run"),
        "may_announce": True,
        "has_children": True,
    }


def test_a_referee_that_is_stopped_is_idle(children, trial):
    one = referee()
    one.assign(trial)
    one.stop()
    assert children[0].stopped == 1
    assert one.trial is None

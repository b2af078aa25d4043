"""What runs were asked for: counted before it is listed, and what its suite's name says."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from olne_bench.bench.plan.learn import describe_here
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, changed
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.submission.asked import asked, check_shipped, planned_trials
from olne_bench.errors import UserError

HOME = Path("/nowhere")


def submission(*runs: tuple[Suite, Selection, int]) -> Any:
    return SimpleNamespace(
        folder=Path("mine"),
        runs=[
            SimpleNamespace(suite=suite.model_dump_json(), selection=chosen, seeds=seeds)
            for suite, chosen, seeds in runs
        ],
        suites=lambda home: [suite for suite, _, _ in runs],  # noqa: ARG005
    )


def suite(**changes: object) -> Suite:
    usual = {"name": "s", "scenarios": ["two_player"], "sensors": ["full"], "sigmas": [0.1]}
    return Suite.model_validate(usual | {"seeds": 3, "estimators": ["uniform"]} | changes)


def test_trials_of_all_runs_are_planned_once() -> None:
    one = (suite(), Selection(), 2)
    more = (suite(), Selection(), 3)
    parts = asked(submission(one, one, more), HOME, 3)
    assert len(parts) == 2
    learnt = parts[0][0]
    assert learnt.metrics  # which a suite learns
    assert planned_trials(parts).keys() == {trial.key for trial in expand(learnt)}


@pytest.mark.parametrize("seeds", [4, 10**8])
def test_numbers_of_trials_are_known_before_they_are_listed(seeds: int) -> None:
    large = suite(seeds=seeds)
    with pytest.raises(UserError, match=f"asks for {seeds} trials, and there are 3 rows"):
        asked(submission((large, Selection(), seeds)), HOME, 3)
    # A suite that says that a fixed scenario is a family says nothing about it.
    told = suite(seeds=seeds, scenarios=[{"name": "two_player", "family": True}], sigmas=[0.0])
    with pytest.raises(UserError, match="trials, and there are 3 rows"):
        asked(submission((told, Selection(), seeds)), HOME, 3)


def test_runs_are_of_few_kinds() -> None:
    runs = [(suite(description=f"d{k}"), Selection(), 1) for k in range(21)]
    assert len(asked(submission(*runs[:20]), HOME, 1)) == 20
    with pytest.raises(UserError, match="its runs are of 21 kinds, at most 20"):
        asked(submission(*runs), HOME, 1)


@pytest.mark.parametrize(
    ("changes", "chosen", "said"),
    [
        ({"scenarios": ["unheard_of"]}, {}, "unheard_of"),
        ({"estimators": ["uniform", "uniform"]}, {}, "'uniform' is listed twice"),
        ({}, {"sensors": ("other",)}, "has no sensor 'other'"),
    ],
)
def test_what_cannot_be_run_is_told_with_the_place(changes: dict, chosen: dict, said: str) -> None:
    with pytest.raises(UserError, match=f"^mine: .*{said}"):
        asked(submission((suite(**changes), Selection(**chosen), 1)), HOME, 9)


def test_a_suite_of_this_package_is_that_suite() -> None:
    quick = load_suite("quick")
    check_shipped(quick)
    check_shipped(quick.model_copy(update={"salt": "mine"}))
    fewer = quick.model_copy(update={"estimators": quick.estimators[:1]})
    check_shipped(fewer)
    own = quick.estimators[0].model_copy(update={"name": "mine.py", "label": "mine"})
    check_shipped(quick.model_copy(update={"estimators": (*quick.estimators, own)}))
    check_shipped(quick.model_copy(update={"name": "other", "time_limit": 0.1}))
    crippled = quick.estimators[0].model_copy(update={"seeds": 1})
    moved = quick.scenarios[0].model_copy(update={"options": {"num_players": 2}})
    for changes, said in (
        ({"time_limit": 0.1}, "time_limit"),
        ({"sigmas": (0.0,)}, "sigmas"),
        ({"seeds": 5}, "seeds"),
        ({"root_iterations": 1}, "root_iterations"),
        ({"estimators": (crippled,)}, "estimator 'kkt_constrained'"),
        ({"scenarios": (moved,)}, "scenario 'merge'"),
        ({"sensors": load_suite("sensors").sensors}, "sensor 'range_bearing'"),
    ):
        with pytest.raises(UserError, match=f"it is not the suite 'quick' .*{said}"):
            check_shipped(quick.model_copy(update=changes))


def test_truths_are_the_solved_draws_of_the_suite_as_in_a_run() -> None:
    """Else no row could be the same bit by bit; another salt has other draws."""
    quick = load_suite("quick")
    for whole, known in ((quick, True), (quick.model_copy(update={"salt": "mine"}), False)):
        trials = planned_trials([(whole, Selection(), 1)]).values()
        assert trials and all((trial.draws is not None) == known for trial in trials)
    fewer = changed(quick, Selection(estimators=("ridge",)), describe_here)
    assert all(trial.draws for trial in planned_trials([(fewer, Selection(), 1)]).values())

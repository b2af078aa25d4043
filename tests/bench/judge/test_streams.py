"""The referee of motions that go on."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from olne_bench.bench.judge import streams as online
from olne_bench.bench.judge.players import Answer, PlayerFault, PlayerTask
from olne_bench.bench.judge.raw_estimate import read_estimate
from olne_bench.bench.judge.streams import Update, follow, prediction_errors
from olne_bench.bench.judge.trials import Case, case_of
from olne_bench.bench.plan.kinds import (
    CLONED,
    CONSTANT_CONTROLS,
    CONSTANT_VELOCITY,
    STOCK,
    STOCK_FITTED,
    TRUE_WEIGHTS,
    Rules,
)
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.run import player as code_of_players
from olne_bench.estimators.protocol import Estimate, Observation

STEPS = 25  # of two_player


def a_motion(estimator: str = "uniform", sigma: float = 0.01, rules: Rules | None = None) -> Trial:
    """A motion of two players."""
    wanted = Selection(scenarios=("two_player",), sensors=("full",), sigmas=(sigma,))
    suite = load_suite("paper", kind="streams", rules=rules.given if rules else None)
    trials = expand(select(suite, wanted), seeds=1)
    return next(m for m in trials if m.estimator.label == estimator)


class Scripted:
    """Answers each sample by a function of the number of samples, and keeps what it gets."""

    def __init__(self, answers: Callable[[int], Answer]) -> None:
        self.samples: list[np.ndarray] = []
        self.answers = answers

    def start(self, task: PlayerTask) -> str | None:
        self.task = task
        return None

    def update(self, sample: np.ndarray) -> Answer:
        self.samples.append(sample)
        return self.answers(len(self.samples))


class Here:
    """The code of a player process, in this one."""

    def start(self, task: PlayerTask) -> str | None:
        return code_of_players.prepare(*code_of_players.told(task)).declined

    def update(self, sample: np.ndarray) -> Answer:
        return Answer(estimate=code_of_players.update(sample, 60.0).estimate, seconds=0.0)


def estimate(weights: float = 1.0, seconds: float = 0.0, **more: object) -> Answer:
    given = np.array([[weights, 1, 1, 1], [1, 1, 1, 1]])
    return Answer(estimate=read_estimate(Estimate(weights=given, **more)), seconds=seconds)


def rows_of(player: Scripted, rules: Rules | None = None) -> list[Update]:
    return list(follow(a_motion(rules=rules), player))


def test_samples_are_handed_out_one_at_a_time() -> None:
    player = Scripted(lambda _: estimate())
    rows = follow(a_motion(rules=Rules(lag=4)), player)
    expected = case_of(a_motion()).observations[0].y
    for count in range(1, STEPS + 1):
        row = next(rows)
        assert (row.sample, row.counted, row.status) == (count, count, "ok")
        assert row.time == pytest.approx((count - 1) * 0.25)
        assert len(player.samples) == count  # and no more than that
    np.testing.assert_array_equal(player.samples, expected)
    assert not any(isinstance(value, np.ndarray) for value in vars(player.task).values())
    assert player.task.lag == 4


@pytest.mark.parametrize("name", ["kkt_constrained", "map", "ukf", "uniform"])
def test_no_estimate_depends_on_the_future(name, monkeypatch) -> None:
    count, lag = 5, None if name == "map" else 4

    def altered(trial: Trial) -> Case:
        case = case_of(trial)
        y = case.observations[0].y.copy()
        y[count:] = 7 - 3 * y[count:]
        return replace(case, observations=(Observation(y),))

    def first() -> list[tuple]:
        motion = a_motion(rules=Rules(lag=lag))
        named = motion.estimator.model_copy(update={"name": name})
        rows = follow(replace(motion, estimator=named), Here())
        own = [next(rows) for _ in range(count)]
        return [(row.status, row.message, row.cosine_error, row.errors) for row in own]

    before = first()
    assert any(status == "ok" and error is not None for status, _, error, _ in before)
    monkeypatch.setattr(online, "case_of", altered)
    assert first() == before  # to the last bit


def test_a_late_estimate_counts_from_the_next_sample_on() -> None:
    times = {2: 0.3}  # seconds; a step has 0.25
    player = Scripted(lambda count: estimate(weights=count, seconds=times.get(count, 0.1)))
    rows = rows_of(player)
    assert [row.counted for row in rows[:4]] == [1, 1, 3, 4]
    assert [row.late for row in rows[:4]] == [False, True, False, False]
    assert rows[1].cosine_error == rows[0].cosine_error != rows[2].cosine_error
    patient = rows_of(Scripted(player.answers), Rules(deadline=0.5))
    assert [row.counted for row in patient[:3]] == [1, 2, 3]
    always = rows_of(Scripted(lambda _: estimate(seconds=9.0)))
    assert [row.counted for row in always[:3]] == [None, 1, 2]
    assert always[0].cosine_error is None and always[0].errors == {}


def test_invalid_estimates_do_not_count() -> None:
    wrong = {2: estimate(np.nan), 3: estimate(converged=False, message="lost")}
    rows = rows_of(Scripted(lambda count: wrong.get(count) or estimate(count)))
    assert [row.status for row in rows[:4]] == ["ok", "invalid", "not_converged", "ok"]
    assert [row.counted for row in rows[:4]] == [1, 1, 1, 4]
    assert rows[2].message == "lost"
    silent = rows_of(Scripted(lambda _: estimate(converged=False)))
    assert silent[0].message == "the estimator gives no reason"


def test_a_fault_ends_the_estimates_of_a_motion() -> None:
    def answers(count: int) -> Answer:
        if count == 3:
            raise PlayerFault("timeout", "killed after 1 s of update")
        return estimate()

    player = Scripted(answers)
    rows = rows_of(player)
    assert len(rows) == STEPS and len(player.samples) == 3
    assert {row.status for row in rows[2:]} == {"timeout"}
    assert {row.counted for row in rows[2:]} == {2}


@pytest.mark.parametrize(
    ("start", "status"), [("crash", "crash"), (None, "skipped")], ids=["fault", "declines"]
)
def test_an_estimator_may_never_begin(start, status) -> None:
    def begin(_: PlayerTask) -> str:
        if start:
            raise PlayerFault(start, "no")
        return "no"

    rows = rows_of(SimpleNamespace(start=begin))
    assert len(rows) == STEPS
    assert {(row.status, row.message, row.counted) for row in rows} == {(status, "no", None)}


def test_errors_of_predictions() -> None:
    case = case_of(a_motion())
    states = case.recordings[0].states.copy()
    states[10:, :, 0] += 3.0
    states[10:, :, 1] += 4.0
    assert prediction_errors(case, states, 10) == {
        f"{kind}_{ahead}s": pytest.approx(5.0) for kind in ("ade", "fde") for ahead in (1, 2, 3)
    }
    assert prediction_errors(case, states, 6)["ade_2s"] == pytest.approx(5.0 / 2)
    assert prediction_errors(case, states, 6)["fde_1s"] == 0.0
    assert prediction_errors(case, states, STEPS) == {}


def test_what_estimators_are_compared_with() -> None:
    def told(name: str) -> list[Update]:
        return list(follow(a_motion(name, sigma=0.0, rules=Rules(fit_every=4)), Here()))

    known, ahead, turning = told(TRUE_WEIGHTS), told(CONSTANT_VELOCITY), told(CONSTANT_CONTROLS)
    assert len(known) == len(ahead) == len(turning) == STEPS
    assert turning[8].errors["fde_1s"] < ahead[8].errors["fde_1s"]
    assert told(STOCK) == told(STOCK_FITTED) == []  # they drive on HighwayEnv's roads only
    cloned = told(CLONED)
    assert [row.status for row in cloned] == ["ok"] * STEPS
    assert cloned[8].errors["fde_1s"] < ahead[8].errors["fde_1s"]
    assert all(row.status == "ok" and row.cosine_error is None for row in (*known, *ahead))
    assert max(row.errors.get("fde_1s", 0.0) for row in known[1:]) < 0.02
    assert ahead[5].errors["fde_3s"] > 0.05
    case = case_of(a_motion(sigma=0.0))
    x, y, heading, speed = case.recordings[0].states[5, 0]
    distance = case.recordings[0].states[9, 0, :2] - [
        x + speed * np.cos(heading),
        y + speed * np.sin(heading),
    ]
    other = case.recordings[0].states[5, 1]
    moved = other[:2] + other[3] * np.array([np.cos(other[2]), np.sin(other[2])])
    expected = np.mean(
        [np.linalg.norm(distance), np.linalg.norm(case.recordings[0].states[9, 1, :2] - moved)]
    )
    assert ahead[5].errors["fde_1s"] == pytest.approx(expected, abs=0.01)

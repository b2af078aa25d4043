"""Misbehaving estimators: each gets its row, and none affects another."""

import subprocess
import time
from dataclasses import replace

import pytest

from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.process.child import TICK
from olne_bench.bench.run.executor import _Shares, run_trials

PART = Selection(scenarios=("two_player",), sensors=("full",), sigmas=(0.05,))

PLUGIN = """
import ctypes, os, signal, subprocess, sys, threading, time
from types import SimpleNamespace
import numpy as np

class Good:
    name = "Good"
    def __init_subclass__(cls):
        cls.name = cls.__name__
    def estimate(self, problem, observation, *, rng, budget):
        print("chatty")
        return SimpleNamespace(weights=np.full((2, 4), 2.0))

class Hangs(Good):
    def estimate(self, *args, **kwargs):
        while True:
            time.sleep(0.1)

class Dies(Good):
    def estimate(self, *args, **kwargs):
        os._exit(7)

class EndsWell(Good):
    def estimate(self, *args, **kwargs):
        os._exit(0)

class Exits(Good):
    def estimate(self, *args, **kwargs):
        sys.exit("done")

class Segfaults(Good):
    def estimate(self, *args, **kwargs):
        ctypes.string_at(0)

class IsKilled(Good):
    def estimate(self, *args, **kwargs):
        os.kill(os.getpid(), signal.SIGKILL)

class Hoards(Good):
    kept = []
    def estimate(self, *args, **kwargs):
        while True:
            self.kept.append(np.ones(2**24))

class Forks(Good):
    def estimate(self, problem, observation, *, rng, budget):
        os.fork()
        return super().estimate(problem, observation, rng=rng, budget=budget)

class LeavesProcess(Good):
    def estimate(self, problem, observation, *, rng, budget):
        subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1234.5)"])
        return super().estimate(problem, observation, rng=rng, budget=budget)

class HidesProcess(Good):
    def estimate(self, problem, observation, *, rng, budget):
        sleep = [sys.executable, "-c", "import time; time.sleep(1234.5)"]
        subprocess.run([sys.executable, "-c", f"import subprocess; subprocess.Popen({sleep!r})"])
        return super().estimate(problem, observation, rng=rng, budget=budget)

class DiesWithAChild(Good):
    def estimate(self, *args, **kwargs):
        if os.fork():
            os._exit(9)
        time.sleep(1234.5)

class TimeBomb(Good):
    def estimate(self, problem, observation, *, rng, budget):
        threading.Timer(1.0, os._exit, [5]).start()
        return super().estimate(problem, observation, rng=rng, budget=budget)

class ClosesEverything(Good):
    def estimate(self, *args, **kwargs):
        os.closerange(0, 100)
        time.sleep(1234.5)

class Raises(Good):
    def estimate(self, *args, **kwargs):
        raise RuntimeError("no\\nidea")

class Mutates(Good):
    def estimate(self, problem, observation, *, rng, budget):
        observation.y[0] = 0

class Shape(Good):
    def estimate(self, *args, **kwargs):
        return SimpleNamespace(weights=np.ones((3, 4)))

class GivesUp(Good):
    def estimate(self, *args, **kwargs):
        return SimpleNamespace(weights=np.ones((2, 4)), converged=False, message="lost")

class Refuses(Good):
    def supports(self, problem):
        return "too many players"

class Random(Good):
    def estimate(self, problem, observation, *, rng, budget):
        return SimpleNamespace(weights=rng.uniform(0.5, 1, (2, 4)))
"""

EXPECTED = {
    "Good": ("ok", ""),
    "Hangs": ("timeout", "killed after 6 s of estimate"),
    "Dies": ("crash", "exit code 7"),
    "EndsWell": ("crash", "died with exit code 0"),
    "Exits": ("crash", "SystemExit: done"),
    "Segfaults": ("crash", "was killed by SIGSEGV (signal 11)"),
    "IsKilled": ("crash", "was killed by SIGKILL (signal 9)"),
    "Hoards": ("crash", "out of memory, the limit is 1 GiB: "),
    "Forks": ("invalid", "left processes running"),
    "LeavesProcess": ("invalid", "left processes running"),
    "HidesProcess": ("invalid", "left processes running"),
    "DiesWithAChild": ("crash", "died with exit code 9"),
    "TimeBomb": ("ok", ""),
    "ClosesEverything": ("crash", "closed its connection"),
    "Raises": ("crash", "RuntimeError: no idea"),
    "Mutates": ("crash", "read-only"),
    "Shape": ("invalid", "weights have the shape (3, 4), expected (2, 4)"),
    "GivesUp": ("not_converged", "lost"),
    "Refuses": ("skipped", "too many players"),
    "Random": ("ok", ""),
}


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plugins")
    plugin = folder / "plugin.py"
    plugin.write_text(PLUGIN)
    suite = load_suite("quick", tuple(f"{plugin}:{name}" for name in EXPECTED))
    part = select(suite, PART)
    trials = [
        # One hangs until its limit. The others must not reach theirs on a busy machine.
        replace(t, time_limit=6.0 if t.estimator.label == "Hangs" else 30.0)
        for t in expand(part, seeds=2)
        if t.estimator.label in EXPECTED and (t.seed == 0 or t.estimator.label == "Random")
    ]
    results = list(run_trials(trials, jobs=2, log=folder / "log", memory=2**30))
    assert len(results) == len(trials)
    by_label = {}
    for trial, outcome in results:
        by_label.setdefault(trial.estimator.label, []).append((trial, outcome))
    return folder, by_label


@pytest.mark.parametrize("label", EXPECTED)
def test_every_misbehaviour_has_its_status(outcomes, label):
    status, message = EXPECTED[label]
    for _, outcome in outcomes[1][label]:
        assert outcome.status == status, outcome
        assert message in outcome.message
        assert "\n" not in outcome.message


@pytest.mark.usefixtures("outcomes")
def test_nothing_that_an_estimator_started_is_left():
    processes = subprocess.run(["ps", "-eo", "args"], check=True, capture_output=True, text=True)
    assert "sleep 1234.5" not in processes.stdout


def test_prints_go_to_the_log(outcomes):
    assert "chatty" in (outcomes[0] / "log").read_text()


def test_weights_are_scaled_to_sum_one(outcomes):
    _, outcome = outcomes[1]["Good"][0]
    assert outcome.weights == [[0.25] * 4] * 2


def test_randomness_is_seeded_by_the_trial_alone(outcomes, judged):
    (first, a), (second, b) = outcomes[1]["Random"]
    assert a.weights != b.weights
    assert judged(first).weights == a.weights
    assert judged(second).weights == b.weights


PATCHES = """
import numpy as np
from types import SimpleNamespace

class Patches:
    name = "Patches"
    def estimate(self, problem, observation, *, rng, budget):
        np.linalg.norm = lambda *args, **kwargs: 1.0
        np.linalg.solve = np.linalg.eigvalsh = None
        return SimpleNamespace(weights=np.ones((2, 4)))
"""


def test_what_a_plugin_changes_in_its_process_reaches_no_other_estimator(tmp_path):
    plugin = tmp_path / "patches.py"
    plugin.write_text(PATCHES)
    rows = []
    for plugins in ((f"{plugin}:Patches",), ()):
        suite = load_suite("quick", plugins)
        part = select(suite, PART)
        trials = sorted(expand(part, seeds=1), key=lambda t: t.estimator.label)  # Patches first
        assert [t.plugin for t in trials] == ["Patches", *[""] * 4][1 - len(plugins) :]
        found = list(run_trials(trials, jobs=1, log=tmp_path / "log"))
        rows.append({t.key: replace(o, solve_seconds=None) for t, o in found if not t.plugin})
    assert rows[0] == rows[1]
    assert {o.status for o in rows[0].values()} == {"ok"}


STAGES = """
import time
from types import SimpleNamespace
import numpy as np

class Slow:
    name = "Slow"
    def warm_up(self, problem):
        time.sleep(self.set_up)
    def estimate(self, problem, observation, *, rng, budget):
        time.sleep(self.work)
        return SimpleNamespace(weights=self.weights, converged=False)

class UsesItsTime(Slow):
    name = "UsesItsTime"
    set_up, work, weights = 2.0, 2.0, np.ones((2, 4))

class SetsUpForLong(Slow):
    name = "SetsUpForLong"
    set_up, work, weights = 60.0, 0.0, np.ones((2, 4))

class EstimatesForLong(Slow):
    name = "EstimatesForLong"
    set_up, work, weights = 0.0, 60.0, np.ones((2, 4))

class Endless:
    def __array__(self, *args, **kwargs):
        time.sleep(60.0)

class IsReadForLong(Slow):
    name = "IsReadForLong"
    set_up, work, weights = 0.0, 0.0, Endless()
"""


def test_each_stage_has_the_time_limit_for_itself(tmp_path):
    plugin = tmp_path / "stages.py"
    plugin.write_text(STAGES)
    expected = {
        "UsesItsTime": ("not_converged", "the estimator gives no reason"),
        "SetsUpForLong": ("timeout", "killed after 3 s of set-up"),
        "EstimatesForLong": ("timeout", "killed after 3 s of estimate"),
        "IsReadForLong": ("timeout", "killed after 3 s of estimate"),
    }
    suite = load_suite("quick", tuple(f"{plugin}:{name}" for name in expected))
    part = select(suite, PART.model_copy(update={"estimators": tuple(expected)}))
    trials = [replace(trial, time_limit=3.0) for trial in expand(part, seeds=1)]
    found = run_trials(trials, jobs=2, log=tmp_path / "log")
    assert {t.estimator.label: (o.status, o.message) for t, o in found} == expected


def test_a_run_waits_for_what_it_has_begun_and_stops_when_asked(tmp_path):
    asked, found = [], []

    def stop():
        asked.append(time.monotonic())
        return bool(found)

    part = select(load_suite("quick"), PART.model_copy(update={"estimators": ("uniform",)}))
    trials = list(expand(part, seeds=3))
    assert len(trials) == 3
    for trial, outcome in run_trials(trials, jobs=1, log=tmp_path / "log", stop=stop):
        found.append((trial.key, outcome.status))
    # One more may have ended while the first was reported, but none was started after it.
    assert [key for key, _ in found] == [trial.key for trial in trials[: len(found)]]
    assert 1 <= len(found) <= 2
    assert found[0][1] == "ok"
    # It sleeps between calls instead of polling all the time.
    assert len(asked) <= 2 * (asked[-1] - asked[0]) / TICK + 20


def test_a_referee_keeps_to_a_draw_and_helps_with_others_at_the_end() -> None:
    chosen = {"scenarios": ("highway", "merge"), "sensors": ("full",), "sigmas": (0.0, 0.05, 0.2)}
    part = select(load_suite("roads"), Selection(estimators=("uniform",), seeds=2, **chosen))
    trials = [*expand(part)]
    shares, referees = _Shares(trials), [object(), object()]
    given = [shares.next(referees[k % 2]) for k in range(len(trials))]
    first = {(trial.scenario.label, trial.seed) for trial in given[:6:2]}
    second = {(trial.scenario.label, trial.seed) for trial in given[1:6:2]}
    assert len(first) == len(second) == 1
    # At first each is where the other is not, as both would wait for one compilation.
    assert first | second == {("highway", 0), ("merge", 0)}
    assert {trial.key for trial in given} == {trial.key for trial in trials}
    # One that is left with nothing takes from the other's draw.
    shares = _Shares(trials[:3])
    assert [shares.next(referees[0]), shares.next(referees[1])] == trials[:2]
    assert (shares.next(referees[1]), shares.next(referees[0])) == (trials[2], None)

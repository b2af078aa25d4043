"""The checks of plugins: each finds its fault, and a good plugin passes all of them."""

import subprocess
import sys
import tomllib
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.conformance import NonConformance, Weakness, estimator_checks
from olne_bench.bench.conformance import conforms as conformance
from olne_bench.bench.conformance.conforms import Check, checks_of, run_check
from olne_bench.bench.conformance.estimator_checks import _case
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.process.child import (
    LeftProcessesError,
    MisspokeError,
    OutOfMemoryError,
    RaisedError,
    TimedOutError,
)
from olne_bench.bench.process.messages import StartError
from olne_bench.errors import UserError
from olne_bench.plugins import ESTIMATOR, KINDS, METRIC, SCENARIO, SENSOR

CHECKS = checks_of(ESTIMATOR)

PLUGIN = """
import time
from types import SimpleNamespace
import numpy as np

calls = []

class Good:
    name = "Good"
    def __init_subclass__(cls):
        cls.name = cls.__name__
    def estimate(self, problem, observation, *, rng, budget):
        shape = (problem.game.num_players, problem.game.num_weights)
        return SimpleNamespace(weights=np.ones(shape))

class Negative(Good):
    def estimate(self, problem, *args, **kwargs):
        result = super().estimate(problem, *args, **kwargs)
        result.weights[0, 0] = -1
        return result

class OtherPlayers(Good):
    def estimate(self, problem, *args, **kwargs):
        return SimpleNamespace(weights=np.ones((problem.game.num_players + 1, 4)))

class Covariance(Good):
    def estimate(self, problem, *args, **kwargs):
        result = super().estimate(problem, *args, **kwargs)
        result.covariance = np.eye(3)
        return result

class Random(Good):
    def estimate(self, problem, *args, **kwargs):
        result = super().estimate(problem, *args, **kwargs)
        result.weights += np.random.random(result.weights.shape)
        return result

class HoldsALambda(Good):
    def __init__(self):
        self.function = lambda: None

class Forgets(Good):
    def __init__(self):
        self.scale = 1.0
    def __getstate__(self):
        return {"scale": 2.0}
    def estimate(self, problem, *args, **kwargs):
        result = super().estimate(problem, *args, **kwargs)
        result.weights[0, 0] = self.scale
        return result

class Writes(Good):
    def estimate(self, problem, observation, **kwargs):
        observation.y[0] = 0
        return super().estimate(problem, observation, **kwargs)

class IsLate(Good):
    def estimate(self, problem, observation, *, rng, budget):
        time.sleep(budget + 0.1)
        return super().estimate(problem, observation, rng=rng, budget=budget)

class BuildsForLong(Good):
    def warm_up(self, problem):
        time.sleep(0.4)

class PassesGapsOn(Good):
    def estimate(self, problem, observation, **kwargs):
        result = super().estimate(problem, observation, **kwargs)
        result.weights += 0 * observation.y.sum()
        return result

class SaysThatGapsStopIt(PassesGapsOn):
    def estimate(self, problem, observation, **kwargs):
        result = super().estimate(problem, observation, **kwargs)
        result.converged, result.message = False, "samples are missing"
        return result

class Overrates(Good):
    def estimate(self, problem, *args, **kwargs):
        assert problem.game.num_players == 2, "two only"
        return super().estimate(problem, *args, **kwargs)

class DeclinesAll(Good):
    def supports(self, problem):
        return "not today"

class GivesNoReason(Good):
    def supports(self, problem):
        return True
"""


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    path = tmp_path_factory.mktemp("plugin") / "plugin.py"
    path.write_text(PLUGIN)
    return path


def check(reference, name, budget=0.3, kind=ESTIMATOR, **parameters):
    return run_check(Check(kind.name, name, str(reference), parameters, budget, time_limit=60))


@pytest.mark.parametrize(
    ("estimator", "name", "expected"),
    [
        ("Negative", "shapes and simplex", "weights are negative: the least is -1"),
        ("OtherPlayers", "shapes and simplex", "the shape (3, 4), expected (2, 4)"),
        ("Covariance", "shapes and simplex", "covariance has the shape (3, 3), expected (8, 8)"),
        ("Random", "determinism under a fixed rng", "two estimates with equal generators differ"),
        ("HoldsALambda", "pickling", "it cannot be pickled"),
        ("Forgets", "pickling", "a pickled copy gives other weights"),
        ("Writes", "inputs are not mutated", "it writes into observation.y"),
        ("IsLate", "deadline is kept", "it took 0.4"),
        ("PassesGapsOn", "missing samples", "weights are not finite"),
        ("Overrates", "supports() is honest", "accepts 3 players in the full view, but then: A"),
        ("DeclinesAll", "supports() is honest", "accepts no problem, not even two players: not to"),
        ("GivesNoReason", "supports() is honest", "supports() returned True: a reason is a str"),
    ],
)
def test_every_check_finds_its_fault(plugin, estimator, name, expected):
    outcome = check(f"{plugin}:{estimator}", name)
    assert outcome.status == "invalid"
    assert expected in outcome.message


def test_an_honest_weak_estimator_is_called_weak_and_conforms(plugin, capsys):
    outcome = check(f"{plugin}:Good", "recovers a noise-free toy")
    assert outcome.status == "ok"
    assert outcome.message.startswith("the cosine error of its weights is 0.0")
    main(["check", f"{plugin}:Good", "--budget", "8"])
    *lines, last = capsys.readouterr().out.splitlines()
    assert [line[:4] for line in lines] == ["pass"] * 8 + ["weak"]
    assert last.endswith("conforms")


def test_a_fault_that_many_checks_find_is_described_once(plugin, capsys):
    with pytest.raises(SystemExit):
        main(["check", f"{plugin}:OtherPlayers", "--budget", "8"])
    said = capsys.readouterr().out
    assert said.count("FAIL  ") == 7
    assert said.count(": the same as in 'shapes and simplex'") == 5  # one says which problem it was


@pytest.mark.parametrize("name", [name for name in CHECKS if name != "recovers a noise-free toy"])
def test_harmless_estimators_pass(plugin, name):
    assert check(f"{plugin}:Good", name).status == "ok"


@pytest.mark.parametrize(
    ("estimator", "name"),
    [("BuildsForLong", "deadline is kept"), ("SaysThatGapsStopIt", "missing samples")],
)
def test_what_is_no_fault_passes(plugin, estimator, name):
    assert check(f"{plugin}:{estimator}", name).status == "ok"


def test_an_exception_names_its_place(plugin):
    outcome = check(f"{plugin}:Overrates", "shapes and simplex")
    assert outcome.status == "crash"
    assert "AssertionError: two only" in outcome.message
    assert "plugin.py:" in outcome.message


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=[pytest.mark.long] * (kind is not METRIC)) for kind in KINDS],
    ids=lambda kind: kind.name,
)
def test_a_new_plugin_passes_its_own_test(kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    name = f"my_{kind.name}"
    main(["new", kind.name, name])
    files = {path.name for path in (tmp_path / name).iterdir()}
    assert files == {"pyproject.toml", f"{name}.py", f"test_{name}.py"}
    metadata = tomllib.loads((tmp_path / name / "pyproject.toml").read_text())["project"]
    class_name = f"My{kind.name.capitalize()}"
    assert metadata["entry-points"] == {kind.group: {name: f"{name}:{class_name}"}}
    capsys.readouterr()
    main(["check", f"{name}/{name}.py:{class_name}", "--budget", "8"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[:-1] == [f"pass  {check}" for check in checks_of(kind)]
    own = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", name]
    assert subprocess.run(own, capture_output=True, timeout=300).returncode == 0


OTHERS = """
import itertools
from dataclasses import replace
import numpy as np
from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.observation import FullView, View
from olne_bench.games.model.sensor import Drops, GapsLayer
import casadi as ca

counter = itertools.count()

class Unlimited:
    name = "unlimited"
    def draw(self):
        return replace(get_scenario("two_player"), limits=None)

class Unsteady(Unlimited):
    def draw(self):
        weights = np.random.default_rng().uniform(1, 2, (2, 4))
        return replace(get_scenario("two_player"), weights=weights)

class Same(Unlimited):
    def draw(self, seed):
        return get_scenario("two_player")

class NoScenario(Unlimited):
    def draw(self):
        return 3

class Sensor:
    name = "sensor"
    def layers(self):
        return ()

class NoTuple(Sensor):
    def layers(self):
        return [FullView()]

class Changing(Sensor):
    def layers(self):
        return (Drops(0.5 / (2 + next(counter))),)

class Kink(View):
    name = "kink"
    def expected(self, state, dynamics):
        return ca.vertcat(state[0], ca.floor(1e7 * state[1]))

class Kinked(Sensor):
    def layers(self):
        return (SHARED,)

SHARED = Kink()

class Halves(GapsLayer):
    def missed(self, rng, blocks):
        return np.ones(len(blocks), dtype=bool)

ALL = Halves()

class Blind(Sensor):
    def layers(self):
        return (ALL,)

class Metric:
    name = "metric"
    def score(self, case):
        return 1.0

class Label(Metric):
    worst = "far"

class Drifts(Metric):
    def score(self, case):
        return float(next(counter))

class Backwards(Metric):
    def score(self, case):
        return 1 / (1 + float(np.abs(case.weights - case.estimate.weights).sum()))

class Beyond(Metric):
    worst = 0.5

class Text(Metric):
    def score(self, case):
        return "good"

class WritesTruth(Metric):
    def score(self, case):
        case.weights[0] = 0.0
"""


@pytest.mark.parametrize(
    ("kind", "name", "which", "expected"),
    [
        (SCENARIO, "Unlimited", 0, "its scenario has no limits"),
        (SCENARIO, "NoScenario", 0, "draw() returned a int"),
        (SCENARIO, "Unsteady", 1, "two draws of seed 0 differ: scenario.weights was"),
        (SCENARIO, "Same", 1, "seeds 0 and 1 draw the same"),
        (SENSOR, "NoTuple", 0, "layers() returned a list"),
        (SENSOR, "Changing", 0, "layers() gives other layers at every call"),
        (SENSOR, "Kinked", 1, "the derivative of h jumps at the state"),
        (SENSOR, "Blind", 2, "it shows nothing at all"),
        (METRIC, "Label", 0, "worst is 'far'"),
        (METRIC, "Drifts", 1, "two scores of one case differ"),
        (METRIC, "Backwards", 2, "an error is least at the truth"),
        (METRIC, "Beyond", 2, "it scores 1.0, beyond its worst value 0.5"),
        (METRIC, "Text", 2, "it returned a str"),
        (METRIC, "WritesTruth", 1, "read-only"),
    ],
)
def test_every_check_of_other_kinds_finds_its_fault(tmp_path, kind, name, which, expected):
    path = tmp_path / "others.py"
    path.write_text(OTHERS)
    outcome = check(f"{path}:{name}", list(checks_of(kind))[which], kind=kind)
    assert outcome.status == "invalid"
    assert expected in outcome.message


def test_one_that_dies_fails_with_exit_code_1(tmp_path, capsys):
    plugin = tmp_path / "dies.py"
    plugin.write_text(
        "import os\nclass Dies:\n    name = 'dies'\n    def layers(self):\n        os._exit(3)\n"
    )
    with pytest.raises(SystemExit) as caught:
        main(["check", str(plugin)])
    assert caught.value.code == 1
    said = capsys.readouterr().out
    first, *others = checks_of(SENSOR)
    assert f"FAIL  {first}: the process died with exit code 3" in said
    assert f"{1 + len(others)} checks failed" in said


UNMADE = """class Unmade:
    name = "unmade"
    def __init__(self):
        raise RuntimeError("no licence")
    def estimate(self, *args, **kwargs): pass
"""


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["check", "nope"], "unknown plugin 'nope'; known are: estimators: behaving"),
        (["check", "nope.py:A"], "nope.py'"),
        (["check", "broken.py"], "broken.py:2)"),
        (["check", "leaves.py"], "SystemExit: bye"),
        (["check", "syntax.py"], "SyntaxError: '(' was never closed ("),
        (["check", "syntax.py"], "syntax.py:1)"),
        (["check", "nul.py"], "null bytes ("),
        (["check", "nul.py"], "nul.py)"),
        (["check", "dies.py"], "plugin 'dies.py' cannot be loaded: the process was killed by SIG"),
        (["check", "interrupts.py"], "KeyboardInterrupt: ("),
        (["check", "interrupts.py"], "interrupts.py:1)"),
        (["check", "unmade.py"], "unmade.py' cannot be made: RuntimeError: no licence ("),
        (["run", "quick", "--plugin", "dies.py", "--out", "o"], "cannot be loaded: the process"),
        (["run", "quick", "--plugin", "unmade.py", "--out", "o"], "unmade.py:4)"),
        (["check", "hangs.py"], "plugin 'hangs.py' cannot be loaded: it takes more than 2 s"),
        (["new", "role", "x"], "'role' is not one of 'estimator', 'scenario'"),
        (["new", "sensor", "full"], "there is a sensor 'full' already"),
        (["check", "drop"], "sensor 'drop' refuses its parameters"),
        (["check", "drop", "--parameter", "p"], "expected NAME=VALUE"),
        (["check", "drop", "--kind", "metric"], "unknown plugin 'drop'; known are: metrics"),
        (["new", "estimator", "My-One"], "cannot call an estimator 'My-One': use lower-case"),
        (["new", "estimator", "class"], "cannot call an estimator 'class'"),
        (["new", "estimator", "uniform"], "there is an estimator 'uniform' already"),
        (["new", "estimator", "taken"], "taken exists already"),
        *(
            (["new", "estimator", name], "use lower-case letters a to z, digits and underscores")
            for name in ("caf\u00e9", "_x")
        ),
        *(
            (["new", "estimator", name], "there is a package or module of this name")
            for name in ("numpy", "json", "bench", "test", "olne_bench")
        ),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, arguments, expected):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.py").write_text("x = 1\nraise RuntimeError('no licence')\n")
    (tmp_path / "leaves.py").write_text("import sys\nsys.exit('bye')\n")
    (tmp_path / "syntax.py").write_text("class A(\n")
    (tmp_path / "nul.py").write_text("x = 0\0\n")
    (tmp_path / "dies.py").write_text("import os\nos.kill(os.getpid(), 11)\n")
    (tmp_path / "interrupts.py").write_text("raise KeyboardInterrupt\n")
    (tmp_path / "hangs.py").write_text("import time\ntime.sleep(60)\n")
    (tmp_path / "unmade.py").write_text(UNMADE)
    (tmp_path / "taken").mkdir()
    monkeypatch.setattr("olne_bench.bench.run.describe_plugins.LOAD_LIMIT", 2.0)
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("olne-bench: error: ")
    assert "\n" not in error
    assert expected in error


@pytest.mark.parametrize("name", ["shapes and simplex", "pickling", "missing samples"])
@pytest.mark.parametrize("estimator", ["kkt_residual", "uniform"])
def test_built_in_estimators_conform(estimator, name):
    assert check(estimator, name, budget=60).status == "ok"


@pytest.mark.parametrize(
    ("kind", "reference", "parameters"),
    [
        (SCENARIO, "two_player", {}),
        (SCENARIO, "random", {"num_players": 2}),
        (SENSOR, "full", {}),
        (SENSOR, "drop", {"p": 0.3}),
        (SENSOR, "correlated", {}),
        (METRIC, "cosine_error", {}),
        (METRIC, "position_error", {}),
    ],
)
def test_other_built_in_plugins_conform(kind, reference, parameters):
    for name in checks_of(kind):
        outcome = check(reference, name, kind=kind, **parameters)
        assert (outcome.status, outcome.message) == ("ok", "")


class Notes:
    """An estimator that notes what it is given."""

    def __init__(self, least=0):
        self.least = least
        self.seen, self.asked, self.warm = [], [], []

    def supports(self, problem):
        self.asked.append(problem)
        return None if problem.game.num_players >= self.least else "too few"

    def warm_up(self, problem):
        self.warm.append(problem)

    def estimate(self, problem, observation, *, rng, budget):
        self.seen.append((problem, observation, rng.uniform(), budget))
        shape = problem.game.num_players, problem.game.num_weights
        return SimpleNamespace(weights=np.ones(shape))


def given_in(name, **options):
    """What a check of an estimator gives to it."""
    notes = Notes(**options)
    with suppress(Weakness):
        CHECKS[name](notes, 30.0)
    assert {budget for *_, budget in notes.seen} <= {30.0}
    assert {number for *_, number, _ in notes.seen} == {np.random.default_rng(0).uniform()}
    assert len(notes.warm) >= 1
    return notes


def kinds(notes):
    return [(p.game.num_players, p.view.name, p.sigma) for p, *_ in notes.seen]


def test_checks_show_two_games_in_two_views_with_little_noise():
    small = given_in("shapes and simplex")
    players, views, sigmas = zip(*kinds(small), strict=True)
    assert (players, views) == ((2, 2, 3, 3), ("full", "partial") * 2)
    assert 0 < max(sigmas) <= 0.02  # cars are apart by more than that
    for problem, observation, *_ in small.seen:
        assert np.isfinite(observation.y).all()
        assert problem.noise_scale == (1.0,) * observation.y.shape[-1]
    assert len(given_in("shapes and simplex", least=3).seen) == 2


def test_a_deadline_is_kept_with_the_most_players_that_are_taken(monkeypatch):
    ((players, view, sigma),) = kinds(given_in("deadline is kept"))
    assert (players, view) == (5, "full")
    assert sigma > 0.02
    clock = [100.0]
    monkeypatch.setattr(estimator_checks.time, "monotonic", lambda: clock[0])
    slow = Notes()
    slow.warm_up = lambda _: clock.append(clock.pop() + 9.0)  # which is no part of it
    slow.estimate = lambda *_, **__: clock.append(clock.pop() + 2.0)
    CHECKS["deadline is kept"](slow, 2.0)
    with pytest.raises(NonConformance, match=r"it took 2\.00 s of a budget of 1\.5 s"):
        CHECKS["deadline is kept"](slow, 1.5)


def test_samples_are_missing_at_the_end_alone_and_in_a_row():
    ((_, observation, *_),) = given_in("missing samples").seen
    gaps = np.isnan(observation.y)
    assert gaps.any() and not gaps.all(axis=(1, 2)).any()
    assert gaps[-1, -1].all()  # at the end
    whole = gaps.all(axis=-1)
    assert whole.sum() < gaps.any(axis=-1).sum()  # of some samples a part is there
    assert np.isnan(observation.y[1:, 1, 0] + observation.y[:-1, 1, 0]).any()
    assert 0 < gaps.mean() < 0.2


def test_support_is_asked_for_twice_and_answered_by_estimates():
    notes = given_in("supports() is honest", least=3)
    assert [one[:2] for one in kinds(notes)] == [(3, "full"), (3, "partial")]
    assert len({id(problem) for problem in notes.asked}) >= 4
    with pytest.raises(NonConformance, match="accepts no problem, not even two players: too few"):
        CHECKS["supports() is honest"](Notes(least=9), 1.0)


def test_a_recovery_is_judged_without_noise_on_different_games():
    notes = Notes()
    weights = [_case("random", "full", 0.0, 2, seed).weights for seed in (0, 1)]
    assert not np.allclose(*weights)
    answers = iter([*weights, weights[0]])
    notes.estimate = lambda p, o, **_: (
        notes.seen.append((p, o)) or SimpleNamespace(weights=next(answers))
    )
    CHECKS["recovers a noise-free toy"](notes, 30.0)
    assert len(notes.seen) == 2
    assert all(problem.sigma == 0 and problem.view.name == "full" for problem, _ in notes.seen)
    with pytest.raises(Weakness, match=r"that of a good estimator at most 0\.001"):
        CHECKS["recovers a noise-free toy"](Notes(), 30.0)


def outcomes_of(monkeypatch, answers):
    """Names of checks and statuses, where the work of each ends so."""
    stopped = []

    def work(function, check, *, kind, seconds):
        assert (function, kind, seconds) == (run_check, Outcome, check.time_limit)
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    child = SimpleNamespace(call=work, stop=lambda: stopped.append(True))
    made = []
    monkeypatch.setattr(conformance, "Child", lambda **words: made.append(words) or child)
    found = list(conformance.run_checks(ESTIMATOR, "mine", {}, budget=2.0, memory=2**30))
    assert stopped == [True]
    assert made[0]["restricted"] and made[0]["memory"] == 2**30
    return found


def test_checks_go_on_after_one_that_fails_but_not_after_one_that_hangs(monkeypatch):
    errors = [MisspokeError("x"), LeftProcessesError("y"), RaisedError("z"), UserError("u")]
    found = outcomes_of(monkeypatch, [*errors, OutOfMemoryError("m"), TimedOutError("")])
    assert [name for name, _ in found] == list(CHECKS)[:6]
    statuses = [outcome.status for _, outcome in found]
    assert statuses == ["invalid", "invalid", "crash", "crash", "crash", "timeout"]
    assert found[-1][1].message == "killed after 68 s"  # more than four estimates
    every = outcomes_of(monkeypatch, [Outcome("ok")] * len(CHECKS))
    assert [name for name, _ in every] == list(CHECKS)
    with pytest.raises(StartError):
        outcomes_of(monkeypatch, [StartError("nothing starts")])

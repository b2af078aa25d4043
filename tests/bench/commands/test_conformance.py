"""The checks of estimators: each finds what it is there for, and a good one passes them all."""

import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.commands.conformance import CHECKS, Check, run_check
from olne_bench.estimators.registry import estimator_names

PLUGIN = """
import time
from types import SimpleNamespace
import numpy as np

calls = []

class Good:
    name = "Good"
    def estimate(self, problem, observation, *, rng, budget):
        shape = (problem.game.num_players, problem.game.num_weights)
        return SimpleNamespace(weights=np.ones(shape))

class Negative(Good):
    name = "Negative"
    def estimate(self, problem, *args, **kwargs):
        result = super().estimate(problem, *args, **kwargs)
        result.weights[0, 0] = -1
        return result

class OtherPlayers(Good):
    name = "OtherPlayers"
    def estimate(self, problem, *args, **kwargs):
        return SimpleNamespace(weights=np.ones((problem.game.num_players + 1, 4)))

class Covariance(Good):
    name = "Covariance"
    def estimate(self, problem, *args, **kwargs):
        result = super().estimate(problem, *args, **kwargs)
        result.covariance = np.eye(3)
        return result

class Random(Good):
    name = "Random"
    def estimate(self, problem, *args, **kwargs):
        result = super().estimate(problem, *args, **kwargs)
        result.weights += np.random.random(result.weights.shape)
        return result

class HoldsALambda(Good):
    name = "HoldsALambda"
    def __init__(self):
        self.function = lambda: None

class Forgets(Good):
    name = "Forgets"
    def __init__(self):
        self.scale = 1.0
    def __getstate__(self):
        return {"scale": 2.0}
    def estimate(self, problem, *args, **kwargs):
        result = super().estimate(problem, *args, **kwargs)
        result.weights[0, 0] = self.scale
        return result

class Writes(Good):
    name = "Writes"
    def estimate(self, problem, observation, **kwargs):
        observation.y[0] = 0
        return super().estimate(problem, observation, **kwargs)

class IsLate(Good):
    name = "IsLate"
    def estimate(self, problem, observation, *, rng, budget):
        time.sleep(budget + 0.1)
        return super().estimate(problem, observation, rng=rng, budget=budget)

class BuildsForLong(Good):
    name = "BuildsForLong"
    def warm_up(self, problem):
        time.sleep(0.4)

class PassesGapsOn(Good):
    name = "PassesGapsOn"
    def estimate(self, problem, observation, **kwargs):
        result = super().estimate(problem, observation, **kwargs)
        result.weights += 0 * observation.y.sum()
        return result

class SaysThatGapsStopIt(PassesGapsOn):
    name = "SaysThatGapsStopIt"
    def estimate(self, problem, observation, **kwargs):
        result = super().estimate(problem, observation, **kwargs)
        result.converged, result.message = False, "samples are missing"
        return result

class Overrates(Good):
    name = "Overrates"
    def estimate(self, problem, *args, **kwargs):
        assert problem.game.num_players == 2, "two only"
        return super().estimate(problem, *args, **kwargs)

class DeclinesAll(Good):
    name = "DeclinesAll"
    def supports(self, problem):
        return "not today"

class GivesNoReason(Good):
    name = "GivesNoReason"
    def supports(self, problem):
        return True
"""


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    path = tmp_path_factory.mktemp("plugin") / "plugin.py"
    path.write_text(PLUGIN)
    return path


def check(reference, name, budget=0.3):
    return run_check(Check(name, str(reference), budget, time_limit=60))


@pytest.mark.parametrize(
    ("estimator", "name", "expected"),
    [
        ("Negative", "shapes and simplex", "weights are negative: the least is -1"),
        ("OtherPlayers", "shapes and simplex", "the shape (3, 4), expected (2, 4)"),
        ("Covariance", "shapes and simplex", "covariance has the shape (3, 3), expected (8, 8)"),
        ("Random", "determinism under a fixed rng", "two estimates with equal generators differ"),
        ("HoldsALambda", "pickling", "it cannot be pickled"),
        ("Forgets", "pickling", "a pickled copy estimates otherwise"),
        ("Writes", "inputs are not mutated", "it writes into observation.y"),
        ("IsLate", "deadline is kept", "it took 0.4"),
        ("PassesGapsOn", "missing samples", "weights are not finite"),
        (
            "Overrates",
            "supports() is honest",
            "accepts 3 players in the full view, but then: Asser",
        ),
        ("DeclinesAll", "supports() is honest", "accepts no problem, not even two players: not to"),
        ("GivesNoReason", "supports() is honest", "supports() returned True: a reason is a str"),
        ("Good", "recovers a noise-free toy", "the cosine error of its weights is 0.0"),
    ],
)
def test_every_check_finds_its_fault(plugin, estimator, name, expected):
    outcome = check(f"{plugin}:{estimator}", name)
    assert outcome.status == "invalid"
    assert expected in outcome.message


@pytest.mark.parametrize("name", [name for name in CHECKS if name != "recovers a noise-free toy"])
def test_harmless_estimators_pass(plugin, name):
    assert check(f"{plugin}:Good", name).status == "ok"


def test_building_solvers_takes_nothing_from_the_budget(plugin):
    assert check(f"{plugin}:BuildsForLong", "deadline is kept").status == "ok"


def test_an_honest_word_on_gaps_passes(plugin):
    assert check(f"{plugin}:SaysThatGapsStopIt", "missing samples").status == "ok"


def test_an_exception_names_its_place(plugin):
    outcome = check(f"{plugin}:Overrates", "shapes and simplex")
    assert outcome.status == "crash"
    assert "AssertionError: two only" in outcome.message
    assert "plugin.py:" in outcome.message


def test_a_new_plugin_conforms_and_others_are_told_apart(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["new", "my_estimator"])
    files = {path.name for path in (tmp_path / "my_estimator").iterdir()}
    assert files == {"pyproject.toml", "my_estimator.py", "test_my_estimator.py"}
    main(["check", "my_estimator/my_estimator.py:MyEstimator", "--budget", "8"])
    lines = capsys.readouterr().out.splitlines()
    assert [f"pass  {name}" in lines for name in CHECKS] == [True] * len(CHECKS)
    assert lines[-1].endswith("conforms")


def test_one_that_dies_fails_with_exit_code_1(tmp_path, capsys):
    plugin = tmp_path / "dies.py"
    plugin.write_text(
        "import os\nclass Dies:\n    name = 'dies'\n    def estimate(self, *a, **k):\n        os._exit(3)\n"
    )
    with pytest.raises(SystemExit) as caught:
        main(["check", str(plugin)])
    assert caught.value.code == 1
    said = capsys.readouterr().out
    assert "FAIL  shapes and simplex: the process died with exit code 3" in said
    assert f"{len(CHECKS)} checks failed" in said


UNMADE = """class Unmade:
    name = "unmade"
    def __init__(self):
        raise RuntimeError("no licence")
    def estimate(self, *args, **kwargs): pass
"""


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["check", "nope"], "unknown estimator 'nope'; known are:"),
        (["check", "nope.py:A"], "no estimator file 'nope.py'"),
        (["check", "broken.py"], "broken.py:2)"),
        (["check", "leaves.py"], "SystemExit: bye"),
        (["check", "syntax.py"], "SyntaxError: '(' was never closed ("),
        (["check", "syntax.py"], "syntax.py:1)"),
        (["check", "nul.py"], "null bytes ("),
        (["check", "nul.py"], "nul.py)"),
        (
            ["check", "dies.py"],
            "estimator 'dies.py' cannot be loaded: the process was killed by SIG",
        ),
        (["check", "interrupts.py"], "KeyboardInterrupt: ("),
        (["check", "interrupts.py"], "interrupts.py:1)"),
        (
            ["check", "unmade.py"],
            "estimator 'unmade.py' cannot be made: RuntimeError: no licence (",
        ),
        (
            ["run", "quick", "--plugin", "dies.py", "--out", "o"],
            "cannot be loaded: the process was",
        ),
        (["run", "quick", "--plugin", "unmade.py", "--out", "o"], "unmade.py:3)"),
        (
            ["check", "hangs.py"],
            "estimator 'hangs.py' cannot be loaded: killed after 2 s of its imp",
        ),
        (["new", "My-Estimator"], "cannot call an estimator 'My-Estimator': use lower-case"),
        (["new", "class"], "cannot call an estimator 'class'"),
        (["new", "uniform"], "there is an estimator 'uniform' already"),
        (["new", "taken"], "taken exists already"),
        (["new", "caf\u00e9"], "use lower-case letters a to z, digits and underscores"),
        (["new", "_x"], "use lower-case letters a to z, digits and underscores"),
        (["new", "numpy"], "there is a package or module of this name"),
        (["new", "json"], "there is a package or module of this name"),
        (["new", "bench"], "there is a package or module of this name"),
        (["new", "test"], "there is a package or module of this name"),
        (["new", "olne_bench"], "there is a package or module of this name"),
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
    monkeypatch.setattr("olne_bench.bench.run.loading.LOAD_LIMIT", 2.0)
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("olne-bench: error: ")
    assert "\n" not in error
    assert expected in error


@pytest.mark.parametrize("name", ["shapes and simplex", "pickling", "missing samples"])
@pytest.mark.parametrize("estimator", sorted({"kkt_residual", "uniform"} & {*estimator_names()}))
def test_built_in_estimators_conform(estimator, name):
    assert check(estimator, name, budget=60).status == "ok"

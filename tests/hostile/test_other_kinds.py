"""Hostile scenarios, sensors and metrics: their faults do not count against an estimator."""

from textwrap import dedent, indent

import pytest
from corpus import HEADER
from running import Run

SCENARIO = """
from dataclasses import replace
from olne_bench.envs.scenarios import get_scenario
class {name}:
    name = "{name}"
    def draw(self, seed):
{work}
        return replace(get_scenario("two_player"), name="{name}")
"""
SENSOR = """
from olne_bench.games.model.observation import FullView
class {name}:
    name = "{name}"
    def layers(self):
{work}
        return (FullView(),)
"""
METRIC = """
class {name}:
    name = "{name}"
    label = "hostile"
    def score(self, case):
{work}
        return 1.0
"""

#: By name: kind, what it does, status of the trials, a phrase of the message.
CASES = {
    "DiesInDraw": (SCENARIO, "os._exit(3)", "harness_error", "exit code 3"),
    "HangsInDraw": (SCENARIO, "time.sleep(4321.25)", "harness_error", "of set-up"),
    "RaisesInDraw": (SCENARIO, "raise KeyboardInterrupt", "harness_error", "KeyboardInterrupt"),
    "DrawsNothing": (SCENARIO, "return None", "harness_error", "set-up"),
    "DrawKillsTheDriver": (
        SCENARIO,
        "os.kill(os.getppid(), signal.SIGKILL)",
        "harness_error",
        "PermissionError",
    ),
    "DrawHoards": (
        SCENARIO,
        "kept = []\nwhile True: kept.append(np.ones(2**22))",
        "harness_error",
        "MemoryError",
    ),
    "DrawLeavesAProcess": (
        SCENARIO,
        "subprocess.Popen(SLEEP, start_new_session=True)",
        "ok",
        "",
    ),
    "DrawPatches": (SCENARIO, "time.sleep(0)\nnp.linalg.norm = None", "", ""),
    "DiesInLayers": (SENSOR, "os._exit(3)", "harness_error", "exit code 3"),
    "RaisesInLayers": (SENSOR, "raise SystemExit", "harness_error", "SystemExit"),
    "dies_in_score": (METRIC, "os._exit(3)", "ok", "exit code 3"),
    "hangs_in_score": (METRIC, "time.sleep(4321.25)", "ok", "metric 'hangs_in_score'"),
    "raises_in_score": (METRIC, "raise KeyboardInterrupt", "ok", "KeyboardInterrupt"),
    "scores_text": (METRIC, "return 'good'", "ok", "expected a number"),
    "scores_infinity": (METRIC, "return np.inf", "ok", "expected a finite number"),
    "score_kills_the_driver": (METRIC, "os.kill(os.getppid(), 9)", "ok", "PermissionError"),
    "score_changes_the_case": (METRIC, "case.estimate.weights[:] = 0", "ok", ""),
}
KINDS = {"scenario": SCENARIO, "sensor": SENSOR, "metric": METRIC}


@pytest.fixture(scope="session")
def alone(tmp_path_factory):
    return Run(tmp_path_factory.mktemp("alone"), []).rows


@pytest.mark.corpus
@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_of_another_kind_is_no_estimators(tmp_path, alone, kind):
    chosen = {name: case for name, case in CASES.items() if case[0] == KINDS[kind]}
    plugins = []
    for name, (template, work, _, _) in chosen.items():
        path = tmp_path / f"{name}.py"
        body = indent(dedent(work), " " * 8)
        path.write_text(HEADER + template.format(name=name, work=body))
        plugins.append(path)
    # One of each kind hangs until the limit; the others must not reach it on a busy machine.
    run = Run(tmp_path / "run", plugins, limit=15.0)
    assert run.code == 0, run.said
    assert "Traceback" not in run.said
    assert run.left == []
    rows = run.rows
    home = rows[(rows["scenario"] == "two_player") & (rows["sensor"] == "full")]
    columns = [name for name in alone.columns if name not in ("message", "versions")]
    assert set(home.index) == {"uniform", "Zebra"}
    if kind == "metric":
        for name, (_, _, status, phrase) in chosen.items():
            assert set(home["status"]) == {status}
            assert all(phrase in message for message in home["message"]), (name, home["message"])
    else:
        for column in columns:
            assert home[column].equals(alone[column]), column
        for name, (_, _, status, phrase) in chosen.items():
            own = rows[rows[kind] == name]
            assert len(own) == 2
            if status:
                assert set(own["status"]) == {status}, (name, list(own["message"]))
                assert all(phrase in message for message in own["message"]), list(own["message"])

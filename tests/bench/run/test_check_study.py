"""The checks that the parts of a suite fit each other."""

import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.plan.entries import ScenarioEntry, SensorEntry
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.run.check_study import check_fit, check_kind, check_priors, misfit
from olne_bench.errors import UserError

UNFIT = {"label": "odd", "stack": ["partial", {"name": "range_bearing"}, "partial"]}


def suite(*sensors: object):
    entries = tuple(SensorEntry.model_validate(sensor) for sensor in sensors)
    return load_suite("quick").model_copy(update={"sensors": entries})


def test_sensors_of_this_package_fit_its_scenarios() -> None:
    check_fit(suite({"label": "full", "name": "full"}, {"label": "lidar", "name": "range_bearing"}))


def test_the_first_pair_that_does_not_fit_is_named() -> None:
    with pytest.raises(UserError) as caught:
        check_fit(suite({"label": "full", "name": "full"}, UNFIT))
    said = str(caught.value)
    assert said.startswith("suite 'quick': sensor 'odd' does not fit scenario 'merge': ")
    assert "\n" not in said
    assert len(said) > 80


def test_what_is_wrong_is_told_as_data() -> None:
    scenario = ScenarioEntry(name="two_player")
    assert misfit(scenario, SensorEntry.model_validate({"name": "full"})) == ""
    assert misfit(scenario, SensorEntry.model_validate(UNFIT)) != ""


SCENARIO = """
from olne_bench.envs.scenarios import get_scenario

class Cars:
    name = "Cars"
    def draw(self):
        return get_scenario("two_player")

class Cannot:
    name = "Cannot"
    def draw(self):
        raise RuntimeError
"""


def test_foreign_scenarios_are_asked_in_a_process_of_their_own(tmp_path) -> None:
    path = tmp_path / "cars.py"
    path.write_text(SCENARIO)
    foreign = ScenarioEntry(name=f"{path}:Cars", label="Cars")
    broken = ScenarioEntry(name=f"{path}:Cannot", label="Cannot")
    full = {"label": "full", "name": "full"}
    with pytest.raises(UserError, match="sensor 'odd' does not fit scenario 'Cars'"):
        check_fit(suite(full, UNFIT).model_copy(update={"scenarios": (broken, foreign)}))


NARROW_SUITE = """
name = "narrow"
scenarios = ["two_player", "random"]
sensors = ["full"]
sigmas = [0.1]
seeds = 1
estimators = [{entry}]
"""
NARROW = '{{name = "{name}", parameters = {{alpha = 1000}}{more}}}'
SKEWED = """
from dataclasses import replace
import numpy as np
from olne_bench.envs.scenarios import get_scenario

class Skewed:
    name = "Skewed"
    def draw(self):
        return replace(get_scenario("two_player"), weights=np.tile([0.7, 0.1, 0.1, 0.1], (2, 1)))

class Cannot:
    name = "Cannot"
    def draw(self):
        raise SystemExit
"""


@pytest.fixture
def suite_file(tmp_path):
    (tmp_path / "mine.py").write_text(SKEWED)

    def write(entry, scenario="Skewed"):
        path = tmp_path / "narrow.toml"
        text = NARROW_SUITE.format(entry=entry)
        path.write_text(text.replace('"two_player"', f'"{tmp_path / "mine.py"}:{scenario}"'))
        return str(path)

    return write


def test_a_run_is_refused_in_one_line(suite_file, tmp_path, capsys):
    path = suite_file(NARROW.format(name="posterior", more=""))
    with pytest.raises(SystemExit) as ended:
        main(["run", path, "--out", str(tmp_path / "run")])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    for part in (
        "'posterior'",
        "'Skewed'",
        "WeightPrior((1000.0,))",
        "'proximity' of player 0 is 0.7",
        "nearer to 1",
    ):
        assert part in said
    assert not (tmp_path / "run").exists()


def test_what_a_prior_reaches_is_run(suite_file):
    entries = (
        '"map"',
        '{name = "posterior", parameters = {alpha = 0.5}}',
        '{name = "map", label = "five", parameters = {alpha = 5}}',
        '"ukf"',
        NARROW.format(name="map", more=', label = "elsewhere", scenarios = ["random"]'),
    )
    check_priors(load_suite(suite_file(", ".join(entries))))


def test_a_scenario_that_cannot_be_drawn_is_shown_by_its_trials(suite_file):
    check_priors(load_suite(suite_file(NARROW.format(name="map", more=""), "Cannot")))


def test_published_weights_of_this_package_are_asked_here(monkeypatch, tmp_path):
    monkeypatch.setattr("olne_bench.bench.run.check_study.Child", None)
    path = tmp_path / "narrow.toml"
    path.write_text(NARROW_SUITE.format(entry=NARROW.format(name="map", more="")))
    check_priors(load_suite(str(path)))  # all weights of two_player are equal
    path.write_text(path.read_text().replace("two_player", "highway_overtaking"))
    with pytest.raises(UserError, match="'map' cannot be run in scenario 'highway_overtaking'"):
        check_priors(load_suite(str(path)))


DRIVES = """
name = "mine"
kind = "{kind}"
sensors = ["full"]
sigmas = [0.1]
seeds = 1
estimators = [{{ name = "map"{planning} }}]
scenarios = [{{ name = "{road}"{options} }}]
rules = {{ {rules} }}
"""
MEETING = ', options = { scene = "encounter", ego = "average" }'
HEDGED = ', planning = "contingency"'


def drives(tmp_path, kind="drives", planning="", road="merge", options="", rules=""):
    path = tmp_path / "mine.toml"
    given = {"planning": planning, "options": options, "rules": rules}
    path.write_text(DRIVES.format(kind=kind, road=road, **given))
    return load_suite(str(path))


def test_encounters_with_a_plan_for_guesses_fit(tmp_path) -> None:
    rules = 'contrasts = [["map", "uniform"]]'
    check_kind(drives(tmp_path, planning=HEDGED, options=MEETING, rules=rules))


def test_an_ego_that_plays_strategies_may_be_known_to_the_others(tmp_path) -> None:
    check_kind(drives(tmp_path, planning=', planning = "feedback"'))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"planning": HEDGED}, "scenario 'merge' has ego = 'known'"),
        ({"options": ', options = { scene = "encounter" }'}, "needs ego = 'average' or 'learnt'"),
        ({"options": ', options = { ego = "famous" }'}, "option ego = 'famous'; drives have"),
        ({"rules": 'contrasts = [["map", "nobody"]]'}, "unknown planner 'nobody'"),
        ({"options": MEETING, "rules": "window = 41"}, "window = 41: a drive has 40 samples"),
    ],
)
def test_drives_that_cannot_be_driven_are_refused(tmp_path, given, message) -> None:
    with pytest.raises(UserError, match=message):
        check_kind(drives(tmp_path, **given))


def test_only_the_ego_of_a_drive_plans(tmp_path) -> None:
    with pytest.raises(UserError, match="planning = 'contingency', in a study of trials"):
        drives(tmp_path, kind="trials", planning=HEDGED)

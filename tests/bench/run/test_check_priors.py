"""The check that priors give truths mass."""

import pytest

from olne_bench.bench.commands.cli import main
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.run.check_priors import check_priors
from olne_bench.errors import UserError

SUITE = """
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
        text = SUITE.format(entry=entry)
        path.write_text(text.replace('"two_player"', f'"{tmp_path / "mine.py"}:{scenario}"'))
        return str(path)

    return write


@pytest.mark.parametrize("name", ["map", "posterior"])
def test_a_run_is_refused_in_one_line(suite_file, tmp_path, name, capsys):
    path = suite_file(NARROW.format(name=name, more=""))
    with pytest.raises(SystemExit) as ended:
        main(["run", path, "--out", str(tmp_path / "run")])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    for part in (
        f"'{name}'",
        "'Skewed'",
        "alpha = 1000",
        "'proximity' of player 0 is 0.7",
        "nearer to 1",
    ):
        assert part in said
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "entry",
    [
        '"map"',
        '{name = "posterior", parameters = {alpha = 0.5}}',
        '{name = "map", parameters = {alpha = 5}}',
        '"ukf"',
        NARROW.format(name="map", more=', scenarios = ["random"]'),
    ],
)
def test_what_a_prior_reaches_is_run(suite_file, entry):
    check_priors(load_suite(suite_file(entry)))


def test_a_scenario_that_cannot_be_drawn_is_shown_by_its_trials(suite_file):
    check_priors(load_suite(suite_file(NARROW.format(name="map", more=""), "Cannot")))


def test_published_weights_of_this_package_are_asked_here(monkeypatch, tmp_path):
    monkeypatch.setattr("olne_bench.bench.run.check_priors.asked", None)
    path = tmp_path / "narrow.toml"
    path.write_text(SUITE.format(entry=NARROW.format(name="map", more="")))
    check_priors(load_suite(str(path)))  # all weights of two_player are equal
    path.write_text(path.read_text().replace("two_player", "highway_overtaking"))
    with pytest.raises(UserError, match="'map' cannot be run in scenario 'highway_overtaking'"):
        check_priors(load_suite(str(path)))

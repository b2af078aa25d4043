"""Scenarios as plugins: what is refused before a draw, and scenarios from files."""

import textwrap

import numpy as np
import pytest

from olne_bench.envs.scenarios import check_options, get_scenario, is_family, scenario_options
from olne_bench.plugins import PluginError


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("random", {"num_players": 10**9}, "num_players must be"),
        ("random", {"num_players": 10**5000}, "num_players"),
        ("random", {"num_players": 0}, "num_players must be"),
        ("random", {"num_players": True}, "num_players must be"),
        ("merge", {"num_players": 7}, "'merge' holds 2 to 6 players, got num_players = 7"),
        ("two_player", {"size": 1}, "'two_player' has no option 'size'; known are: weights"),
        ("nope", {}, "unknown scenario 'nope'; known are: changed, following, highway"),
    ],
)
def test_options_are_refused_without_drawing(name, options, expected):
    for call in (check_options, get_scenario):
        with pytest.raises(PluginError) as caught:
            call(name, **options)
        assert expected in str(caught.value)


def test_seeds_fit_into_tables():
    assert get_scenario("random", 2**63 - 1).name == "random"
    for seed in (2**63, 10**5000):
        with pytest.raises(ValueError, match=r"a seed is an integer below 2\*\*63, got"):
            get_scenario("random", seed)


FILE = """
from dataclasses import replace
from olne_bench.envs.scenarios import get_scenario
import starts

class Moved:
    name = "moved"
    def __init__(self, by=0.5):
        self.by = by
    def draw(self, seed):
        import starts
        known = get_scenario("two_player")
        return replace(known, name="moved", initial_state=known.initial_state + starts.shift(self))

class Broken:
    name = "broken"
    def draw(self):
        raise SystemExit("no licence")

class Nothing:
    name = "nothing"
    def draw(self):
        return None
"""


def test_a_scenario_from_a_file(tmp_path):
    path = tmp_path / "moved.py"
    path.write_text(textwrap.dedent(FILE))
    (tmp_path / "starts.py").write_text("def shift(plugin):\n    return plugin.by\n")
    name = f"{path}:Moved"
    assert is_family(name)
    assert scenario_options(name) == ["by"]
    moved = get_scenario(name, 3, by=0.25)
    known = get_scenario("two_player").initial_state
    np.testing.assert_array_equal(moved.initial_state, known + 0.25)
    assert not is_family(f"{path}:Broken")
    with pytest.raises(PluginError, match="cannot be drawn: SystemExit: no licence"):
        get_scenario(f"{path}:Broken")
    with pytest.raises(PluginError, match="has to draw an olne_bench"):
        get_scenario(f"{path}:Nothing")

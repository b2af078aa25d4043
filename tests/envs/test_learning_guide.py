"""The recipes of docs/learning.md run as written, but for the number of steps, on all roads."""

import re
from pathlib import Path

import pytest

from olne_bench.envs.gym_ids import GYM_IDS
from olne_bench.envs.highway_roads import ROAD_NAMES

PAGE = Path(__file__).parents[2] / "docs" / "learning.md"
EGO, PLAYERS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)

SHORT = "n_steps=16, batch_size=8, n_epochs=1"

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of other libraries


def run(recipe: str, here: str, instead: str) -> dict:
    """The names of a recipe after a few steps, at one place of the page in place of another."""
    pytest.importorskip("stable_baselines3", reason="the extra 'rl' is not installed")
    for old, new in ((here, instead), ("n_steps=64", SHORT), ("learn(10_000)", "learn(1)")):
        assert recipe.count(old) == 1, old
        recipe = recipe.replace(old, new)
    names: dict = {}
    exec(recipe, names)
    return names


@pytest.mark.parametrize("name", GYM_IDS)
def test_one_ego_among_nash_traffic(name):
    names = run(EGO, '"olne/NashMerge-v0"', f'"{name}"')
    assert names["model"].num_timesteps == 16
    assert names["world"].spec.id == name


@pytest.mark.parametrize("road", ROAD_NAMES)
def test_all_players_of_a_scenario(road):
    names = run(PLAYERS, '"merge"', f'"{road}"')
    players = len(names["world"].possible_agents)
    assert names["model"].num_timesteps == 16 * 2 * players

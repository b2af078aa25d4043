"""The recipes of docs/learning.md run on all roads as written, except for the number of steps.

They run in another process: PyTorch may crash in one that has opened a window (see the page).
"""

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.envs.worlds.gym_ids import GYM_IDS

pytestmark = pytest.mark.learners

PAGE = Path(__file__).parents[2] / "docs" / "learning.md"
EGO, DRIVE, PLAYERS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
STEPS = 8
CHANGES = (
    ("n_steps=64", f"n_steps={STEPS}, batch_size=8, n_epochs=1"),
    ("learn(10_000)", "learn(1)"),
)
FEW = ("draws=8", "draws=1")  # drawing takes seconds
RUN_ALL = """
import json, sys
for name, recipe in json.load(sys.stdin).items():
    names = {}
    exec(recipe, names)
    world = names["world"]
    players = getattr(world, "possible_agents", ["ego"])
    print(json.dumps([name, names["model"].num_timesteps, len(players)]), flush=True)
"""


def changed(recipe: str, *changes: tuple[str, str]) -> str:
    for old, new in (*CHANGES, *changes):
        assert recipe.count(old) == 1, old
        recipe = recipe.replace(old, new)
    return recipe


@pytest.fixture(scope="module")
def outcomes() -> dict[str, tuple[int, int]]:
    """The number of steps that each recipe trained for, and its number of players."""
    if importlib.util.find_spec("stable_baselines3") is None:
        pytest.skip("the extra 'rl' is not installed")
    recipes = {name: changed(EGO, ("olne/NashMerge-v0", name)) for name in GYM_IDS}
    recipes["drive"] = changed(DRIVE)
    recipes |= {road: changed(PLAYERS, ('"merge"', f'"{road}"'), FEW) for road in ROAD_NAMES}
    done = subprocess.run(
        [sys.executable, "-c", RUN_ALL],
        input=json.dumps(recipes),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]
    return {name: (steps, players) for name, steps, players in rows}


@pytest.mark.parametrize("name", GYM_IDS)
def test_one_ego_among_nash_traffic(name, outcomes):
    assert outcomes[name] == (STEPS, 1)


def test_the_ego_of_a_drive(outcomes):
    assert outcomes["drive"] == (STEPS, 1)


@pytest.mark.parametrize("road", ROAD_NAMES)
def test_all_players_of_a_scenario(road, outcomes):
    steps, players = outcomes[road]
    assert players >= 3
    assert steps == STEPS * 2 * players  # two worlds

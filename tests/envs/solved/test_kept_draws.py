"""Draws kept on disk: exact to the last bit, only of played worlds, only of this user."""

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from olne_bench.envs import highway_v0, olne_v0
from olne_bench.envs.olne_v0 import make_world
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.solved import KEPT_DRAWS, equilibrium, kept_draws
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.games.solve.olne import solve_olne
from olne_bench.kept_files import sealed


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path: Path) -> Path:
    """A new folder, and empty caches, as in a new process."""
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(tmp_path / "cache"))
    equilibrium._solve.cache_clear()
    found = KEPT_DRAWS.folder
    assert found == tmp_path / "cache-draws"
    yield found
    equilibrium._solve.cache_clear()


def kept(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.exists() else []


@pytest.fixture(scope="module")
def scenario():
    return get_scenario("random", 0, num_players=2)


def test_what_is_kept_is_the_same_to_the_last_bit(scenario, folder):
    with kept_draws.keeping():
        first = certified_equilibrium(scenario)
        (path,) = kept(folder)
        equilibrium._solve.cache_clear()
        read = certified_equilibrium(scenario)
    solved = solve_olne(scenario.game, scenario.weights, scenario.initial_state, search_far=True)
    for name in ("states", "controls", "costates"):
        assert getattr(first, name).tobytes() == getattr(read, name).tobytes(), name
        np.testing.assert_allclose(getattr(read, name), getattr(solved, name), atol=1e-8)
    assert read.certificate.passed and str(read.certificate) == str(solved.certificate)
    assert kept(folder) == [path]
    assert not read.states.flags.writeable


def test_a_second_reset_solves_nothing(folder, monkeypatch):
    world = olne_v0.parallel_env("random", num_players=2)
    world.reset(seed=3)
    shown = world.state()
    assert kept(folder)
    equilibrium._solve.cache_clear()
    monkeypatch.setattr(equilibrium, "solve_olne", None)
    world.reset(seed=3)
    np.testing.assert_array_equal(world.state(), shown)


def test_a_road_is_read_in_another_process(folder):
    code = (
        "from olne_bench.envs.solved import equilibrium\n"
        "from olne_bench.envs import highway_v0; import sys\n"
        "if sys.argv[1] == 'again': equilibrium.solve_olne = None\n"
        "world = highway_v0.parallel_env('merge', num_players=2)\n"
        "world.reset(seed=0); print(world.state().tobytes().hex())"
    )
    told = [
        subprocess.run(
            [sys.executable, "-c", code, turn],
            env=os.environ | {"OLNE_BENCH_CACHE": str(folder.with_name("cache"))},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for turn in ("first", "again")
    ]
    assert told[0] == told[1] != ""


def test_only_what_a_world_draws_itself_is_kept(scenario, folder, monkeypatch):
    """The referee draws and solves scenarios and hands them to worlds: no truth is kept."""
    get_scenario("merge", 0, num_players=2)
    certified_equilibrium(scenario)
    make_world(scenario).reset()
    highway_v0.parallel_env(get_scenario("merge", 0, num_players=2)).reset()
    assert kept(folder) == []
    monkeypatch.setenv("OLNE_BENCH_DRAWS", "0")
    olne_v0.parallel_env("two_player").reset()
    assert kept(folder) == []


def test_another_game_start_weight_or_code_is_another_file(scenario, monkeypatch):
    def name(one) -> str | None:
        return kept_draws.name_of(one.game, one.weights, one.initial_state)

    other = scenario.weights[::-1].copy()
    variants = [
        scenario,
        replace(scenario, weights=other),
        replace(scenario, initial_state=scenario.initial_state + 1e-12),
        replace(scenario, game=replace(scenario.game, dt=scenario.game.dt * (1 + 1e-15))),
    ]
    with kept_draws.keeping():
        names = {name(one) for one in variants}
        assert len(names) == 4
        monkeypatch.setattr(kept_draws, "_surroundings", lambda: ("new",))
        assert name(scenario) not in names
    assert name(scenario) is None


@dataclass(frozen=True)
class Own:
    """A feature with a field that has no text."""

    table: np.ndarray


def test_what_cannot_be_told_apart_is_not_kept(scenario):
    player = replace(scenario.game.players[0], task=(Own(np.zeros(2)),))
    game = replace(scenario.game, players=(player, *scenario.game.players[1:]))
    with kept_draws.keeping():
        assert kept_draws.name_of(game, scenario.weights, scenario.initial_state) is None


@pytest.mark.parametrize("content", [b"", b"no draws", sealed(b"no draws"), sealed(b"\x90")])
def test_what_is_no_draw_is_solved_anew(scenario, folder, content):
    with kept_draws.keeping():
        first = certified_equilibrium(scenario)
        (path,) = kept(folder)
        path.write_bytes(content)
        equilibrium._solve.cache_clear()
        assert certified_equilibrium(scenario).states.tobytes() == first.states.tobytes()


def test_games_with_constraints_are_not_kept(folder):
    olne_v0.parallel_env("merging").reset()
    assert kept(folder) == []

"""Draws kept on disk: exact to the last bit, only of played worlds, only of this user."""

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from olne_bench.envs import highway_v0, olne_v0
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.solved import equilibrium, kept_draws
from olne_bench.envs.solved.draws_folder import draws_folder
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.envs.worlds.of_scenario import make_world
from olne_bench.games.solve.olne import Equilibrium, solve_olne

ARRAYS = ("states", "controls", "costates")


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path: Path) -> Path:
    """A new folder, and empty caches, as in a new process."""
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(tmp_path / "cache"))
    equilibrium._solve.cache_clear()
    found = draws_folder()
    assert found == tmp_path / "cache-draws"
    yield found
    equilibrium._solve.cache_clear()


def kept(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.exists() else []


@pytest.fixture(scope="module")
def scenario():
    return get_scenario("random", 0, num_players=2)


@pytest.fixture(scope="module")
def solved(scenario) -> Equilibrium:
    return solve_olne(scenario.game, scenario.weights, scenario.initial_state, search_far=True)


def assert_same(a: Equilibrium, b: Equilibrium) -> None:
    for name in ARRAYS:
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name
    assert (a.residual, a.certificate.tolerance) == (b.residual, b.certificate.tolerance)
    assert a.certificate.passed is b.certificate.passed
    assert a.certificate.costs.tobytes() == b.certificate.costs.tobytes()
    assert a.certificate.global_so_far is not None and b.certificate.global_so_far is not None
    pairs = zip(
        (a.certificate.local, a.certificate.global_so_far),
        (b.certificate.local, b.certificate.global_so_far),
        strict=True,
    )
    for mine, theirs in pairs:
        assert mine.values.tobytes() == theirs.values.tobytes()
        np.testing.assert_array_equal(mine.starts, theirs.starts)
        assert mine.passed is theirs.passed


def test_what_is_kept_is_the_same_to_the_last_bit(scenario, solved, folder):
    with kept_draws.keeping():
        first = certified_equilibrium(scenario)
        (path,) = kept(folder)
        equilibrium._solve.cache_clear()
        read = certified_equilibrium(scenario)
    assert_same(first, solved)
    assert_same(read, solved)
    assert kept(folder) == [path]
    assert not read.states.flags.writeable
    assert folder.stat().st_mode & 0o777 == 0o700
    assert path.stat().st_mode & 0o077 == 0


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
        "from olne_bench.envs.solved import equilibrium\nfrom olne_bench.envs import highway_v0; import sys\n"
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
    def name(one) -> Path | None:
        return kept_draws.file_of(one.game, one.weights.tobytes(), one.initial_state.tobytes())

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
        assert kept_draws.file_of(game, b"", b"") is None


def damage(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-40] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    "spoil",
    [
        damage,
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(path.read_bytes()[:100]),
        lambda path: path.chmod(0o666),
        lambda path: path.parent.chmod(0o777),
        lambda path: path.symlink_to(path.rename(path.with_suffix(".moved"))),
    ],
    ids=["bit", "empty", "cut", "writable", "folder writable", "link"],
)
def test_what_cannot_be_trusted_is_solved_anew(scenario, solved, folder, spoil):
    with kept_draws.keeping():
        certified_equilibrium(scenario)
        (path,) = kept(folder)
        spoil(path)
        assert kept_draws.read(path) is None
        equilibrium._solve.cache_clear()
        assert_same(certified_equilibrium(scenario), solved)


def test_the_least_recently_used_go(solved, folder, monkeypatch):
    monkeypatch.setattr(kept_draws, "MOST_FILES", 3)
    for number in range(5):
        path = folder / f"{number}.npz"
        kept_draws.write(path, solved)
        os.utime(path, (number, number))
    assert [path.name for path in kept(folder)] == ["2.npz", "3.npz", "4.npz"]
    assert kept_draws.read(folder / "2.npz") is not None  # now the latest
    kept_draws.write(folder / "5.npz", solved)
    assert [path.name for path in kept(folder)] == ["2.npz", "4.npz", "5.npz"]

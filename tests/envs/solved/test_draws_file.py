"""A file of solved draws: what is read is what was written, or nothing."""

import pickle
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.roads import road_scenario
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import Scenario
from olne_bench.envs.solved import draws_file, equilibrium, kept_draws
from olne_bench.envs.solved.draws_file import (
    Draws,
    OtherDrawsError,
    key_of,
    read_draws,
    write_draws,
)
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.games.solve.olne import solve_olne
from olne_bench.kept_files import sealed

ABOUT = {"suite": "small", "salt_id": "s"}


@pytest.fixture(autouse=True)
def no_cache() -> None:
    equilibrium._solve.cache_clear()


@pytest.fixture(scope="module")
def scenarios() -> list[Scenario]:
    return [get_scenario("random", seed, num_players=2 + seed) for seed in (0, 1)]


@pytest.fixture(scope="module")
def solved(scenarios):
    return [solve_olne(s.game, s.weights, s.initial_state, search_far=True) for s in scenarios]


@pytest.fixture
def file(scenarios, solved, tmp_path: Path) -> Path:
    draws = Draws(about=ABOUT)
    for scenario, truth in zip(scenarios, solved, strict=True):
        draws.add(scenario.game, scenario.weights, truth)
    other = get_scenario("random", 5, num_players=2)
    draws.refuse(other.game, other.weights, other.initial_state)
    write_draws(tmp_path / "a.draws", draws)
    return tmp_path / "a.draws"


def test_what_is_read_is_the_root_that_was_written(file, scenarios, solved, monkeypatch) -> None:
    draws = read_draws(file)
    assert draws.about == ABOUT
    monkeypatch.setattr(equilibrium, "solve_olne", None)
    with kept_draws.travelling(draws):
        for scenario, truth in zip(scenarios, solved, strict=True):
            read = certified_equilibrium(scenario)
            for name in ("states", "controls", "costates"):
                np.testing.assert_allclose(getattr(read, name), getattr(truth, name), atol=1e-8)
            assert read.residual < 1e-12 and not read.states.flags.writeable
            np.testing.assert_array_equal(read.certificate.costs, truth.certificate.costs)
            assert read.certificate.passed
            for part in ("local", "global_so_far"):
                mine, theirs = (getattr(c, part) for c in (read.certificate, truth.certificate))
                np.testing.assert_allclose(mine.values, theirs.values, atol=1e-6)
                np.testing.assert_array_equal(mine.starts, theirs.starts)
        with pytest.raises(NoEquilibriumError, match="refused when the suite's draws were made"):
            certified_equilibrium(get_scenario("random", 5, num_players=2))


def test_what_is_not_there_is_solved(file) -> None:
    with kept_draws.travelling(read_draws(file)):
        assert certified_equilibrium(get_scenario("random", 6, num_players=2)).certificate.passed


def test_a_motion_is_small_and_the_same_draws_give_the_same_bytes(
    file, scenarios, tmp_path
) -> None:
    values = sum(np.prod(s.game.control_shape) for s in scenarios)
    assert file.stat().st_size < 4 * values + 2500
    write_draws(tmp_path / "b.draws", read_draws(file))
    assert (tmp_path / "b.draws").read_bytes() == file.read_bytes()


def test_rounding_of_another_machine_is_no_other_draw(scenarios) -> None:
    one = scenarios[0]
    own = key_of(one.game, one.weights, one.initial_state)
    assert key_of(one.game, one.weights * (1 + 1e-15), one.initial_state + 1e-16) == own
    assert key_of(one.game, one.weights, one.initial_state + 1e-7) != own
    assert key_of(replace(one.game, horizon=24), one.weights, one.initial_state) != own


def test_a_motion_of_another_game_is_refused(file, scenarios) -> None:
    """As after a change of code: the same weights and start, but other costs."""
    one, draws = scenarios[0], read_draws(file)
    changed = get_scenario("random", 3, num_players=2).game  # other goals
    with pytest.raises(OtherDrawsError, match=r"a\.draws: a motion in it is no equilibrium"):
        draws.equilibrium(changed, one.weights, one.initial_state)


@pytest.mark.parametrize("damage", ["cut", "changed", "empty", "other"])
def test_a_wrong_hash_is_refused(file, damage) -> None:
    content = bytearray(file.read_bytes())
    content[-5] ^= 1
    told = {"cut": content[:500], "changed": content, "empty": b"", "other": b"x" * 5000}
    file.write_bytes(told[damage])
    with pytest.raises(OtherDrawsError, match=r"draws file .*a\.draws has a wrong hash"):
        read_draws(file)


def test_another_version_is_refused(file, monkeypatch) -> None:
    draws = read_draws(file)
    monkeypatch.setattr(draws_file, "VERSION", 0)
    write_draws(file, draws)
    monkeypatch.undo()
    with pytest.raises(OtherDrawsError, match="is of another version than 2, which this"):
        read_draws(file)


def solved_motion(**changes) -> list:
    """A motion as it is in a file, of one step, one player and two controls."""
    kept = {"shape": [1, 1, 2], "tolerance": 1e-6, "controls": bytes(8), "costs": bytes(8)}
    kept |= {"local": bytes(4), "local_starts": bytes(2), "far": bytes(4), "far_starts": bytes(2)}
    return list((kept | changes).values())


KEY = b"k" * 16
NAN = np.array([np.nan, 0], "<f4").tobytes()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"motions": {KEY: solved_motion(controls=bytes(4))}}, "controls of a motion have a wrong"),
        ({"motions": {KEY: solved_motion(far=bytes(3))}}, "far of a motion have a wrong size"),
        ({"motions": {KEY: solved_motion(controls=NAN)}}, "controls of a motion are not finite"),
        ({"motions": {KEY: solved_motion(controls="text")}}, "Expected `bytes`, got `str`"),
        ({"motions": {KEY: solved_motion(shape=[0, 1, 2])}}, "of the shape (0, 1, 2) cannot be"),
        ({"motions": {KEY: solved_motion(shape=[2**40, 2**40, 2])}}, "have a wrong size"),
        ({"motions": {KEY: solved_motion(tolerance=np.nan)}}, "cannot be"),
        ({"motions": {KEY: solved_motion()[:-1]}}, "Expected `array` of at least length 8"),
        ({"motions": {b"short": solved_motion()}}, "a key has another length than 16 bytes"),
        ({"refused": [b"short"]}, "a key has another length than 16 bytes"),
        ({"about": {"suite": 3}}, "Expected `str`, got `int`"),
        ({"version": "2"}, "Expected `int`, got `str`"),
        ({"version": 3}, "of another version than 2"),
        ({"more": 1}, "unknown field `more`"),
    ],
)
def test_what_is_signed_and_no_draws_is_refused(tmp_path, content, reason) -> None:
    file = tmp_path / "a.draws"
    file.write_bytes(sealed(msgspec.msgpack.encode({"version": 2} | content)))
    with pytest.raises(OtherDrawsError) as caught:
        read_draws(file)
    assert reason in str(caught.value) and str(file) in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [b"no draws", b"PK\x03\x04", pickle.dumps([1]), b"\x91" * 10**5, b"\xdf" + b"\xff" * 4],
)
def test_what_is_signed_and_no_message_is_refused(tmp_path, content) -> None:
    (tmp_path / "a.draws").write_bytes(sealed(content))
    with pytest.raises(OtherDrawsError, match="is damaged or of another version"):
        read_draws(tmp_path / "a.draws")


def test_a_motion_of_another_shape_is_refused(file, scenarios) -> None:
    one, draws = scenarios[0], read_draws(file)
    key = key_of(one.game, one.weights, one.initial_state)
    kept, changed = draws.motions[key], draws.motions[key].array("controls")
    for controls in (changed[1:], np.full_like(changed, 1e38)):
        draws.motions[key] = msgspec.structs.replace(
            kept, shape=controls.shape, controls=controls.tobytes()
        )
        with pytest.raises(OtherDrawsError, match="a motion in it is no equilibrium of its game"):
            draws.equilibrium(one.game, one.weights, one.initial_state)


def test_a_missing_file_is_named(tmp_path) -> None:
    with pytest.raises(OtherDrawsError, match=r"none\.draws cannot be read: No such file"):
        read_draws(tmp_path / "none.draws")


def test_no_draws_are_a_file_too(tmp_path) -> None:
    write_draws(tmp_path / "a.draws", Draws(about=ABOUT))
    found = read_draws(tmp_path / "a.draws")
    assert (found.about, found.motions, found.refused) == (ABOUT, {}, set())


def test_draws_of_games_with_constraints_are_not_kept() -> None:
    draws, scenario = Draws(), get_scenario("merging")
    draws.add(scenario.game, scenario.weights, certified_equilibrium(scenario))
    draws.refuse(scenario.game, scenario.weights, scenario.initial_state)
    assert not draws.motions and not draws.refused


def test_rejected_proposals_are_noted_and_accepted_ones_not_played_again(
    scenarios, solved, monkeypatch
) -> None:
    found = Draws()
    reasons = iter(["collision", None])
    monkeypatch.setattr(road_scenario, "_reason", lambda _: next(reasons))
    with kept_draws.collecting(found):
        assert [road_scenario.rejection(one) for one in scenarios] == ["collision", None]
    one, other = scenarios
    assert found.is_refused(one.game, one.weights, one.initial_state)
    assert not found.is_refused(other.game, other.weights, other.initial_state)
    found.add(other.game, other.weights, solved[1])
    with kept_draws.travelling(found):
        assert road_scenario.rejection(other) is None  # without asking a third time

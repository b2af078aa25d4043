"""A file of solved draws: what is read is what was written, or nothing."""

import hashlib
import io
import json
import pickle
import warnings
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.roads import playability
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
    with pytest.raises(OtherDrawsError, match="is of another version than 1, which this"):
        read_draws(file)


def rewritten(file: Path, **arrays: np.ndarray | None) -> None:
    """Replace arrays of a file of draws, or remove them; its hash is right."""
    buffer = io.BytesIO()
    with np.load(io.BytesIO(file.read_bytes()[32:])) as known:
        kept = {name: array for name, array in (dict(known) | arrays).items() if array is not None}
    np.savez_compressed(buffer, **kept)
    signed(file, buffer.getvalue())


def signed(file: Path, content: bytes) -> None:
    file.write_bytes(hashlib.sha256(content).digest() + content)


def text(value: object) -> np.ndarray:
    return np.frombuffer(json.dumps(value).encode(), np.uint8)


HEADER = {"version": 1, "tolerance": 1e-6, "suite": "a", "salt_id": "b"}


@pytest.mark.parametrize(
    ("arrays", "reason"),
    [
        ({"controls": None}, "There is no item named 'controls.npy'"),
        ({"controls": np.zeros(3, "<f4")}, "controls has 3 numbers"),
        ({"controls": np.zeros(3, "<f8")}, "controls has the type float64"),
        ({"controls": np.zeros((3, 1), "<f4")}, "and the shape (3, 1)"),
        ({"costs": np.array([np.nan, 1.0])}, "costs is not finite"),
        ({"shapes": np.zeros((1, 3), "<u2")}, "impossible shapes"),
        ({"shapes": np.full((1, 3), 65535, "<u2")}, "numbers, expected"),
        ({"keys": np.zeros(5, np.uint8)}, "keys are cut off"),
        ({"refused": np.zeros(32, np.uint8)}, "or repeat"),
        ({"keys": np.array([{}])}, "keys has the type object"),
        ({"header": np.zeros(3, np.uint8)}, "is damaged"),
        ({"header": text(["a"])}, "of another version"),
        ({"header": text({"version": 1})}, "it has no 'tolerance'"),
        ({"header": text(HEADER | {"tolerance": float("nan")})}, "its header is not that of draws"),
        ({"header": text(HEADER | {"suite": 3})}, "its header is not that of draws"),
        ({"header": np.frombuffer(b"[" * 10**5, np.uint8)}, "is damaged"),
    ],
)
def test_what_is_signed_and_no_draws_is_refused(file, arrays, reason) -> None:
    rewritten(file, **arrays)
    with pytest.raises(OtherDrawsError) as caught:
        read_draws(file)
    assert reason in str(caught.value) and str(file) in str(caught.value)


@pytest.mark.parametrize("content", [b"no archive", b"PK\x03\x04", pickle.dumps([1]), b"\x93NUMPY"])
def test_what_is_signed_and_no_archive_is_refused(file, content) -> None:
    signed(file, content)
    with pytest.raises(OtherDrawsError, match="is damaged: File is not a zip file"):
        read_draws(file)


def test_no_memory_is_taken_for_what_an_array_only_claims(file, monkeypatch) -> None:
    claimed = b"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999,), }".ljust(118)
    header = b"\x93NUMPY\x01\x00\x76\x00" + claimed
    buffer = io.BytesIO(file.read_bytes()[32:])
    with ZipFile(buffer, "a") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a name that is there twice: the last one counts
        archive.writestr("controls.npy", header)
    signed(file, buffer.getvalue())
    with pytest.raises(OtherDrawsError, match="controls has 0 bytes for the shape"):
        read_draws(file)
    monkeypatch.setattr(draws_file, "_MOST_BYTES", 10)
    signed(file, buffer.getvalue() + b" ")
    with pytest.raises(OtherDrawsError, match="at most 10 are read"):
        read_draws(file)


def test_a_motion_of_another_shape_is_refused(file, scenarios) -> None:
    one, draws = scenarios[0], read_draws(file)
    key = key_of(one.game, one.weights, one.initial_state)
    kept = draws.motions[key]
    for controls in (kept.controls[1:], np.full_like(kept.controls, 1e38)):
        draws.motions[key] = kept._replace(controls=controls)
        with pytest.raises(OtherDrawsError, match="a motion in it is no equilibrium of its game"):
            draws.equilibrium(one.game, one.weights, one.initial_state)


def test_a_missing_file_is_named(tmp_path) -> None:
    with pytest.raises(OtherDrawsError, match=r"none\.draws cannot be read: No such file"):
        read_draws(tmp_path / "none.draws")


def test_no_draws_are_a_file_too(tmp_path) -> None:
    write_draws(tmp_path / "a.draws", Draws(about=ABOUT))
    found = read_draws(tmp_path / "a.draws")
    assert (found.about, found.motions, found.refused) == (ABOUT, {}, set())


def test_games_with_constraints_are_not_kept() -> None:
    draws, scenario = Draws(), get_scenario("merging")
    draws.add(scenario.game, scenario.weights, certified_equilibrium(scenario))
    draws.refuse(scenario.game, scenario.weights, scenario.initial_state)
    assert not draws.motions and not draws.refused


def test_rejected_proposals_are_noted_and_accepted_ones_not_played_again(
    scenarios, solved, monkeypatch
) -> None:
    found = Draws()
    reasons = iter(["collision", None])
    monkeypatch.setattr(playability, "_reason", lambda _: next(reasons))
    with kept_draws.collecting(found):
        assert [playability.rejection(one) for one in scenarios] == ["collision", None]
    one, other = scenarios
    assert found.is_refused(one.game, one.weights, one.initial_state)
    assert not found.is_refused(other.game, other.weights, other.initial_state)
    found.add(other.game, other.weights, solved[1])
    with kept_draws.travelling(found):
        assert playability.rejection(other) is None  # without asking a third time

"""Recordings are what worlds play, and are played again."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pettingzoo.test import parallel_api_test

from olne_bench.envs import highway_v0, olne_v0
from olne_bench.envs.olne_v0 import make_world
from olne_bench.envs.recordings import recording as recordings
from olne_bench.envs.recordings.recording import NoEquilibriumError, film, record
from olne_bench.envs.recordings.recording_file import (
    CertificateEntry,
    RecordingFileError,
    of_recordings,
    read_recording,
    write_recording,
)
from olne_bench.envs.scenarios import get_scenario
from olne_bench.envs.scenarios.scenario import Limits
from olne_bench.envs.solved.equilibrium import certified_equilibrium

PAPER = ["two_player", "highway_overtaking"]


@pytest.mark.parametrize("name", [*PAPER, "random"])
def test_worlds_play_the_equilibrium(name, recorded):
    truth = certified_equilibrium(get_scenario(name))
    np.testing.assert_allclose(recorded(name).states, truth.states, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(recorded(name).controls, truth.controls)
    assert recorded(name).certificate.passed


def test_highway_env_plays_its_equilibrium(recorded):
    played = recorded("merge", num_players=2)
    truth = certified_equilibrium(played.scenario)
    np.testing.assert_allclose(played.states, truth.states, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "module"), [("two_player", olne_v0), ("random", olne_v0), ("merge", highway_v0)]
)
def test_every_scenario_has_its_world(name, module):
    assert type(make_world(get_scenario(name))) is module.parallel_env


def test_states_come_from_the_world(monkeypatch):
    class Drifting(olne_v0.OlneWorld):
        drift = 1e-10

        def state(self):
            return super().state() + self.drift

    scenario = get_scenario("two_player")
    truth = certified_equilibrium(scenario)
    monkeypatch.setattr(recordings, "make_world", Drifting)
    moved = record(scenario).states - truth.states
    np.testing.assert_allclose(moved, 1e-10, rtol=0, atol=1e-13)
    Drifting.drift = 1e-6
    with pytest.raises(NoEquilibriumError, match=r"1\.0e-06 away from its equilibrium"):
        record(scenario)


def test_players_who_leave_early_are_no_truth(monkeypatch):
    class Short(olne_v0.OlneWorld):
        def __init__(self, scenario):
            super().__init__(scenario, max_cycles=3)

    monkeypatch.setattr(recordings, "make_world", Short)
    with pytest.raises(NoEquilibriumError, match="leave the world at step 4 of 25"):
        record(get_scenario("two_player"))


def test_controls_beyond_the_limits_are_no_truth():
    scenario = get_scenario("two_player")
    with pytest.raises(NoEquilibriumError, match="beyond the scenario's limit"):
        record(replace(scenario, limits=Limits((1e-3, 1e-3), scenario.limits.states)))


def test_one_frame_per_state(recorded):
    frames = list(film(get_scenario("two_player")))
    assert len(frames) == len(recorded("two_player").states)
    assert all(frame.dtype == np.uint8 and frame.std() > 5 for frame in frames)
    assert (frames[0] != frames[-1]).any()


def test_certificates_of_older_files_are_read():
    known = {"gains": [0.0], "costs": [1.0], "tolerance": 1e-7, "passed": True}
    entry = CertificateEntry.model_validate(known)
    assert entry.local is None and entry.global_so_far is None


def test_files_keep_everything(tmp_path, recorded):
    seeds = [0, 1, 2]  # with different numbers of players
    recordings = [recorded("random", seed) for seed in seeds]
    assert len({len(r.scenario.weights) for r in recordings}) > 1
    path = tmp_path / "random.parquet"
    write_recording(path, of_recordings(recordings, seeds, {}))
    known = read_recording(path)
    assert (known.metadata.kind, known.metadata.scenario) == ("truth", "random")
    assert known.metadata.weight_names == list(recordings[0].scenario.game.weight_names)
    assert known.metadata.versions.keys() >= {"olne-bench", "numpy", "casadi", "pettingzoo"}
    for index, played in enumerate(recordings):
        np.testing.assert_array_equal(known.states[index], played.states)
        np.testing.assert_array_equal(known.controls[index], played.controls)
        np.testing.assert_allclose(known.times[index], 0.25 * np.arange(25))
        entry = known.metadata.episodes[index]
        assert entry.seed == seeds[index]
        np.testing.assert_array_equal(entry.weights, played.scenario.weights)
        np.testing.assert_array_equal(entry.certificate.gains, played.certificate.gains)
        assert entry.certificate.passed
        assert entry.certificate.local.gains == played.certificate.local.values.tolist()
        far = entry.certificate.global_so_far
        players = len(played.scenario.weights)
        assert far.passed and far.starts == [17 + 4 * (players - 1)] * players
        assert far.gains == played.certificate.global_so_far.values.tolist()
    rows = pq.read_table(path).to_pandas()
    assert rows.loc[rows["time"] == rows["time"].max(), "yaw_rate"].isna().all()
    assert rows.loc[rows["time"] < rows["time"].max(), "yaw_rate"].notna().all()


@pytest.fixture
def file(tmp_path, recorded):
    path = tmp_path / "two.parquet"
    write_recording(path, of_recordings([recorded("two_player")], [0], {}))
    return path


def test_what_is_no_recording_is_refused(tmp_path):
    path = tmp_path / "other.parquet"
    with pytest.raises(RecordingFileError, match="no recording"):
        read_recording(path)
    path.write_text("time,player\n")
    with pytest.raises(RecordingFileError, match="not a Parquet file"):
        read_recording(path)
    pq.write_table(pa.table({"a": [1]}), path)
    with pytest.raises(RecordingFileError, match="is not a recording"):
        read_recording(path)


@pytest.mark.parametrize("damage", ["rows", "column", "metadata"])
def test_a_damaged_file(file, damage):
    table = pq.read_table(file)
    if damage == "rows":
        table = table.slice(1)
    elif damage == "column":
        table = table.drop_columns("heading")
    else:
        table = table.replace_schema_metadata({b"olne_bench": b'{"kind": "guess"}'})
    pq.write_table(table, file)
    with pytest.raises(RecordingFileError, match="damaged"):
        read_recording(file)


@pytest.fixture
def recording(recorded):
    return recorded("two_player")


def test_it_is_a_world_like_any_other(recording) -> None:
    parallel_api_test(recording.world(), num_cycles=60)


def test_the_recording_is_shown_with_its_extra_state_and_the_time(recording) -> None:
    world = recording.world()
    game = recording.scenario.game
    expected = [*recording.states, recording.extra_state]
    for _ in range(2):  # repeatedly
        shown, infos = world.reset(seed=3)
        assert infos == {"player_0": {}}
        for step, states in enumerate(expected):
            assert world.agents == ["player_0"] * (step < game.horizon)
            np.testing.assert_array_equal(shown["player_0"], [*states.ravel(), step * game.dt])
            np.testing.assert_array_equal(world.state(), shown["player_0"])
            assert world.observation_space("player_0").contains(shown["player_0"])
            if world.agents:
                shown, rewards, over, cut, _ = world.step({})
                assert rewards == {"player_0": 0.0}
                assert over == {"player_0": step == game.horizon - 1}
                assert cut == {"player_0": False}
        assert world.step({}) == ({}, {}, {}, {}, {})
    with pytest.raises(ValueError, match="read-only"):
        world.state()[0] = 1.0


def test_blocks_are_players_in_the_order_of_their_indices(recording) -> None:
    world = recording.world()
    shown, _ = world.reset()
    layout = world.observation_layout
    assert layout.num_players == 2
    np.testing.assert_array_equal(
        layout.by_index(shown["player_0"], "player_0"), recording.states[0]
    )


def test_a_world_that_was_never_reset_stands_at_the_first_step(recording) -> None:
    world = recording.world()
    np.testing.assert_array_equal(world.state(), [*recording.states[0].ravel(), 0.0])
    assert world.agents == []
    idle = world.action_space("player_0")
    assert idle.is_bounded() and idle.contains(np.zeros(idle.shape))  # actions have no effect

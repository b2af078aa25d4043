"""Recordings as CommonRoad scenarios: motion and lanes come back."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from olne_bench.envs.scenarios.roundabout import Roundabout
from olne_bench.envs.tracks.export import Episode, write_commonroad
from olne_bench.envs.tracks.reading import read_tracks
from olne_bench.envs.tracks.road import locate
from olne_bench.envs.tracks.road_file import highway_road, road_file
from olne_bench.errors import UserError

NAMES = ["px", "py", "heading", "speed"]


def episode() -> Episode:
    """Two cars on the roundabout that drive straight on."""
    scenario = Roundabout().propose(np.random.default_rng(0), 2)
    states = np.repeat(scenario.initial_state[None], 6, axis=0)
    way = np.stack([np.cos(states[..., 2]), np.sin(states[..., 2])], axis=-1)
    times = 0.1 * np.arange(6)
    states[..., :2] += times[:, None, None] * states[..., 3:] * way
    return Episode(["a", "b"], times, states, NAMES, 0.1, road_file(scenario))


def test_motion_and_lanes_come_back(tmp_path: Path) -> None:
    path, written = tmp_path / "road.xml", episode()
    assert write_commonroad(path, written) == {"a": "1", "b": "2"}
    known = read_tracks(path, "commonroad").recording
    np.testing.assert_allclose(known.states[0], written.states, atol=1e-9)
    entry = known.metadata.episodes[0]
    assert entry.players == ["1", "2"] and entry.road is not None
    original = highway_road("roundabout").lanes
    # Lanelets have numbers in the order of the lanes, after the two obstacles.
    numbers = {name: str(3 + k) for k, name in enumerate(original)}
    found = {name: lane.lane() for name, lane in entry.road.lanes.items()}
    for name, lane in original.items():
        if numbers[name] not in found:  # far from both cars
            continue
        back = found[numbers[name]]
        assert back.width == lane.width or abs(back.width - lane.width) < 1e-6
        assert locate(back.line, lane.line).distance.max() < 0.15
        np.testing.assert_allclose(back.line[[0, -1]], lane.line[[0, -1]], atol=1e-6)
        expected = {numbers[other] for other in lane.following} & set(found)
        assert set(back.following) == expected
    assert len(found) > 10


def test_gaps_and_unknown_headings_are_written(tmp_path: Path) -> None:
    path, written = tmp_path / "road.xml", episode()
    states = written.states[..., :2].copy()
    states[2, 0] = np.nan
    states[:, 1] = states[0, 1]  # it stands, so its heading is unknown
    bare = replace(written, states=states, state_names=NAMES[:2], road=None)
    write_commonroad(path, bare)
    known = read_tracks(path, "commonroad").recording
    np.testing.assert_array_equal(np.isnan(known.states[0][:, 0, 0]), np.isnan(states[:, 0, 0]))
    np.testing.assert_array_equal(known.states[0][:, 1, 2:], 0.0)
    assert known.metadata.episodes[0].road is None


def test_what_writing_needs_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "commonroad.common.file_writer", None)
    with pytest.raises(UserError, match=r"pip install 'olne-bench\[commonroad\]'"):
        write_commonroad(tmp_path / "road.xml", episode())

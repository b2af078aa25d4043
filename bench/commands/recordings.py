"""Recordings that commands read."""

from pathlib import Path

import numpy as np

from olne_bench.envs.recordings.recording_file import RecordingFile, read_recording
from olne_bench.envs.tracks.checks import check_positions, check_steps, check_units
from olne_bench.envs.tracks.table import STATE_NAMES
from olne_bench.errors import UserError


def read_episode(path: Path, episode: int) -> RecordingFile:
    """Read a recording and check that it has an episode, of a motion of cars."""
    known = read_recording(path)
    if episode >= len(known.states):
        raise UserError(
            f"--episode {episode}: {path} has the episodes 0 to {len(known.states) - 1}"
        )
    _check_motion(path, known, episode)
    return known


def _check_motion(path: Path, known: RecordingFile, episode: int) -> None:
    """Refuse an episode that is no motion of cars in metres and seconds."""
    names, states = known.metadata.state_names, known.states[episode]
    players = known.metadata.episodes[episode].players
    if names[:2] != ["px", "py"]:
        raise UserError(
            f"{path} has the states {', '.join(names) or 'none'}; expected px and py first"
        )
    check_steps(path, known.times[episode])
    motion = np.full((*states.shape[:2], len(STATE_NAMES)), np.nan)
    for k, name in enumerate(STATE_NAMES.values()):
        if name in names:
            motion[..., k] = states[..., names.index(name)]
    check_positions(path, motion, players)
    check_units(path, motion, known.metadata.dt, players)

"""Recordings that commands read."""

from pathlib import Path

from olne_bench.envs.recording_file import RecordingFile, read_recording
from olne_bench.errors import UserError


def read_episode(path: Path, episode: int) -> RecordingFile:
    """Read a recording and check that it has an episode.

    Raises:
        UserError: on a file that is not a recording, or an episode that it does not have.
    """
    known = read_recording(path)
    if episode >= len(known.states):
        raise UserError(
            f"--episode {episode}: {path} has the episodes 0 to {len(known.states) - 1}"
        )
    return known

"""Commands of ``olne-bench`` that work on recording files, one file each."""

from bench.commands.estimate import estimate
from bench.commands.import_tracks import import_tracks
from bench.commands.record import record

COMMANDS = (estimate, import_tracks, record)

"""Commands of ``olne-bench`` that work on recording files, one file each."""

from bench.commands import estimate, import_tracks, record

COMMANDS = (estimate.estimate, import_tracks.import_tracks, record.record)

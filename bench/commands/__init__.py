"""Commands of ``olne-bench``, one file each."""

from bench.commands import estimate, import_tracks, merge, record, report, run, status

COMMANDS = (
    estimate.estimate,
    import_tracks.import_tracks,
    merge.merge,
    record.record,
    report.report,
    run.run,
    status.status,
)

"""Commands of ``olne-bench``, one file each."""

from bench.commands import check, estimate, import_tracks, merge, new, record, report, run, status

COMMANDS = (
    check.check,
    estimate.estimate,
    import_tracks.import_tracks,
    merge.merge,
    new.new,
    record.record,
    report.report,
    run.run,
    status.status,
)

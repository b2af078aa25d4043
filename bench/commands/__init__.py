"""Commands of ``olne-bench``, one file each."""

from olne_bench.bench.commands import (
    check,
    compare,
    estimate,
    gate,
    import_tracks,
    merge,
    new,
    record,
    report,
    run,
    status,
)

COMMANDS = (
    check.check,
    compare.compare,
    estimate.estimate,
    gate.gate,
    import_tracks.import_tracks,
    merge.merge,
    new.new,
    record.record,
    report.report,
    run.run,
    status.status,
)

"""``olne-bench status``: which trials of a run are done, failed, stale or missing."""

from typing import Any

import click

from olne_bench.bench.commands.options import PATH


@click.command()
@click.argument("folder", type=PATH)
def status(**given: Any) -> None:
    """Show how far the run in FOLDER is.

    done: the result is valid, or the estimator declined the trial. failed: there is no valid
    result. harness_error: the trial could not be judged, which does not count against the
    estimator. stale: parameters or code of scenario, sensor, estimator or scoring have changed
    since. missing: not run yet. The time left of missing and stale trials is estimated from the
    mean time of each estimator's trials in this folder.
    """
    from olne_bench.bench.commands.status import status as work

    work(**given)

"""``olne-bench online``: run a suite's trials as motions that go on, one sample at a time."""

from typing import Any

import click

from olne_bench.bench.commands.interface.study_options import study_options
from olne_bench.bench.commands.options import FiniteRange

#: Repeats ``estimators.stream.LEAST_LAG``, whose import is slow.
LEAST_LAG = 2


@click.command()
@click.argument("suite", default="online")
@study_options
@click.option(
    "--lag",
    type=click.IntRange(min=LEAST_LAG),
    help="Number of latest samples that count. Default: all so far.",
)
@click.option(
    "--deadline",
    type=FiniteRange(min=1e-3),
    help="Time in which an update has to end [s]. Default: until the next sample.",
)
@click.option(
    "--fit-stock",
    type=click.IntRange(min=2),
    metavar="N",
    help="Fit HighwayEnv's drivers, too, after every N-th sample; a fit takes seconds to a minute.",
)
def online(suite: str, **options: Any) -> None:
    """Run SUITE, a name or a TOML file, one sample at a time.

    An estimator gets one sample after the other and estimates after each. An update that ends after
    the next sample is late, and the former estimate counts for that sample. Motions that are in the
    folder are not run again, unless the code of their scenario, sensor, estimator or scoring has
    changed. Latencies are those of a machine on which as many motions run as --jobs says.
    """
    from olne_bench.bench.commands.online import online as work

    work(suite, **options)

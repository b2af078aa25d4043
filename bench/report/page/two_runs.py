"""One page for two runs: the trials of both, with the second run's estimators renamed.

The page shows one estimator in two runs as the page of a run shows two estimators.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd

from olne_bench.bench.report.page.render import Extras, render_page
from olne_bench.bench.report.statistics.attempts import FLOOR, weighed
from olne_bench.bench.report.study import Study
from olne_bench.bench.report.tables import tabulate
from olne_bench.bench.run.provenance import Provenance

_PLACE = ["scenario", "sensor", "sigma", "seed"]

#: A run's name, trials and provenance.
Run = tuple[str, pd.DataFrame, Sequence[Provenance]]


def two_runs_page(
    first: Run, second: Run, names: Mapping[str, str], changes: pd.DataFrame, study: Study
) -> str:
    """The page of two runs as HTML.

    Args:
        first: a run.
        second: another run, or the same.
        names: estimators to show, label in the first run to label in the second.
        changes: table of ``bench.report.statistics.run_comparison``.
        study: study of both runs.
    """
    (name, old, sources), (other, new, others) = first, second
    renamed = {label: after_name(label, names) for label in names.values()}
    old, new = old[old["estimator"].isin(names)], new[new["estimator"].isin(renamed)]
    shared = old[_PLACE].drop_duplicates().merge(new[_PLACE].drop_duplicates())
    # The floor is the same in both runs, and is recognised by its name.
    new = new.assign(estimator=new["estimator"].map(renamed))
    new = new[new["estimator"] != FLOOR]
    trials = pd.concat([table.merge(shared) for table in (old, new)], ignore_index=True)
    later = {renamed[n]: study.estimators[n] for n in renamed if n in study.estimators}
    whole = replace(study, estimators={**study.estimators, **later})
    tables = tabulate(weighed(trials), whole)
    notes = [f"only the trials that both {name} and {other} have are on this page", *tables.notes]
    extras = Extras(title=f"{name} and {other}", changes=changes)
    return render_page(trials, tables, [*sources, *others], whole, notes, extras).html


def after_name(label: str, names: Mapping[str, str]) -> str:
    """The name of a second run's estimator on the page."""
    return f"{label} (second)" if label in names and label != FLOOR else label

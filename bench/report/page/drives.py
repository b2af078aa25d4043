"""The page of a study of drives: summary, tests, figures."""

from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.page.template import csv_texts, repeats, script, table_rows, template
from olne_bench.bench.run.provenance import Provenance


def driving_page(
    tables: Mapping[str, pd.DataFrame],
    pictures: Iterable[Path],
    runs: Sequence[Provenance],
    suite: Suite,
) -> str:
    """The page as HTML.

    Args:
        tables: ``summary`` and ``tests``, as ``report.driving`` makes them.
        pictures: PNG files to show.
        runs: provenance of the rows, the latest run last.
        suite: suite of that run.
    """
    summary = tables["summary"]
    return template("drives.html").render(
        title=f"{suite.name}: drives",
        description=suite.description,
        summary=table_rows(summary),
        tests=table_rows(tables["tests"]),
        drives=int(summary.loc[summary["road"] != "all", "drives"].sum()),
        references=suite.references,
        rules=suite.rules,
        pictures=[b64encode(path.read_bytes()).decode() for path in pictures],
        command=repeats(runs[-1], suite),
        runs=list(runs),
        data={"tables": csv_texts(tables)},
        script=script(("look", "save", "online")),
    )

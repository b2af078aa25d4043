"""The page of a study of drives: summary, tests, figures."""

from collections.abc import Iterable, Mapping, Sequence

import pandas as pd
from markupsafe import Markup

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.page import tables as t
from olne_bench.bench.report.page.template import csv_texts, lead_of, repeats, study_page
from olne_bench.bench.run.provenance import Provenance

_LEAD = (
    "Planners differ in the weights that they give the others; all begin at the same starts, with "
    "the same noise."
)
_SUMMARY: dict[str, t.Content] = {
    "Road": "road",
    "Traffic": "traffic",
    "Noise": "sigma",
    "Planner": "planner",
    "Drives": "drives",
    "Collisions [%]": t.ends("collision", 100),
    "Regret [%]": t.ends("regret", 100),
    "Progress [m]": "progress",
    "Jerk [m/s³]": "jerk",
    "Error in 3 s [m]": "fde_3s",
    "Cycle [ms]": "cycle_50",
    "99 % [ms]": "cycle_99",
    "Late": t.share("late"),
}
_TESTS: dict[str, t.Content] = {
    "What": "column",
    "Road": "road",
    "Traffic": "traffic",
    "Planner": "planner",
    "Less": "other",
    "Drives": "pairs",
    "Difference": "difference",
    "p (Holm)": t.p_value("p_holm"),
}


def driving_page(
    tables: Mapping[str, pd.DataFrame],
    pictures: Iterable[str],
    runs: Sequence[Provenance],
    suite: Suite,
) -> str:
    """The page as HTML.

    Args:
        tables: ``summary`` and ``tests``, as ``report.drive_tables`` makes them.
        pictures: SVG elements of the figures.
        runs: provenance of the rows, the latest run last.
        suite: suite of that run.
    """
    summary = tables["summary"]
    return study_page(
        title=f"{suite.name}: drives",
        lead=lead_of(suite.description, _LEAD),
        facts=[
            (int(summary.loc[summary["road"] != "all", "drives"].sum()), "drives"),
            (suite.rules.window, "samples in a window"),
        ],
        sections=[("summary", "Cost and collisions"), ("provenance", "Provenance")],
        board=_board(summary, suite),
        pictures=[Markup(picture) for picture in pictures],
        more=[("Paired tests", [_tests(tables["tests"])])],
        what="All but times come out the same again, if no estimate is late:",
        command=repeats(runs[-1], suite),
        runs=list(runs),
        data={"tables": csv_texts(tables)},
    )


def _board(summary: pd.DataFrame, suite: Suite) -> t.Table:
    note = (
        "Regret is the mean cost less that of the oracle in the same drives, in hundredths of what "
        "standing costs. Shares and regrets have 95 % intervals; all else are medians."
    )
    return t.table_of(
        summary,
        _SUMMARY,
        name="summary",
        note=note,
        quiet=lambda row: row["planner"] in suite.references,
    )


def _tests(table: pd.DataFrame) -> t.Table:
    note = (
        "Means of the planner less the other in the same drives; permutation tests, adjusted after "
        "Holm for all lines."
    )
    return t.table_of(table, _TESTS, name="tests", note=note)

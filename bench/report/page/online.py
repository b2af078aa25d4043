"""Pages of studies in which estimates are made while a motion goes on: of streams, of drives."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd
from markupsafe import Markup

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.page import tables as t
from olne_bench.bench.report.page.template import csv_texts, lead_of, repeats, study_page
from olne_bench.bench.report.statistics.pairs import SIGNIFICANCE
from olne_bench.bench.run.provenance import Provenance

_STREAMS_LEAD = (
    "An estimator gets one sample after the other, and estimates after each. Medians and their "
    "95 % intervals are over motions, each of which counts by its median over samples."
)
_DRIVES_LEAD = (
    "Planners differ in the weights that they give the others; all begin at the same starts, with "
    "the same noise."
)
_PLACE: t.Columns = t.own("scenario", "sensor") | {"Noise": "sigma", "Estimator": "estimator"}
_ERROR_COLUMNS: t.Columns = {
    "Cosine error": t.ends("cosine_error"),
    "Half time [s]": t.ends("half_time"),
    **{f"{ahead} s [m]": t.ends(f"fde_{ahead}s") for ahead in (1, 2, 3, 4)},
    "Motions": "motions",
    "Failed": t.share("failed"),
}
_LATENCY_COLUMNS: t.Columns = {
    "Median [ms]": "latency_50",
    **{f"{level} % [ms]": f"latency_{level}" for level in (95, 99)},
    "Late": t.share("late"),
    "Updates": "updates",
}
_DRIVE: t.Columns = {**t.own("road", "traffic"), "Noise": "sigma", **t.own("planner", "drives")}
_DRIVE_COLUMNS: t.Columns = {
    "Collisions [%]": t.ends("collision", 100),
    "Regret [%]": t.ends("regret", 100),
    "Progress [m]": "progress",
    "Error in 3 s [m]": "fde_3s",
}
_CYCLE_COLUMNS: t.Columns = {
    "Jerk [m/s³]": "jerk",
    "Cycle [ms]": "cycle_50",
    "99 % [ms]": "cycle_99",
    "Late": t.share("late"),
}
_TEST_COLUMNS: t.Columns = {
    "What": "column",
    **t.own("road", "traffic", "planner"),
    "Less": "other",
    "Drives": "pairs",
    "Difference": "difference",
    "p (Holm)": t.p_value("p_holm"),
}


_TESTS = (
    "Means of the planner less the other in the same drives; permutation tests, adjusted after "
    "Holm for all lines."
)


def online_page(
    tables: Mapping[str, pd.DataFrame],
    pictures: Iterable[str],
    runs: Sequence[Provenance],
    suite: Suite,
) -> str:
    """The page of streams or drives as HTML: their tables, and figures as SVG elements."""
    parts = _streams(tables, suite) if suite.kind == "streams" else _drives(tables, suite)
    return study_page(
        **parts,
        pictures=[Markup(picture) for picture in pictures],
        command=repeats(runs[-1], suite),
        runs=list(runs),
        data={"tables": csv_texts(tables)},
    )


def _streams(tables: Mapping[str, pd.DataFrame], suite: Suite) -> dict[str, Any]:
    summary = tables["summary"]
    cells = summary.groupby(["scenario", "sensor", "sigma"])
    return {
        "title": f"{suite.name}, one sample at a time",
        "lead": lead_of(suite.description, _STREAMS_LEAD),
        "facts": [
            (int(cells["motions"].max().sum()), "motions"),
            (int(summary["updates"].sum()), "updates"),
            (suite.rules.lag or "all", "samples count"),
        ],
        "sections": [("summary", "Weights and predictions"), ("provenance", "Provenance")],
        "board": _summary(summary, suite),
        "more": [
            ("Comparisons of predictions", [_comparisons(tables["comparisons"])]),
            ("Latency", [_latency(summary, suite)]),
        ],
        "what": "All but latencies come out the same again, if no update is late:",
    }


def _summary(table: pd.DataFrame, suite: Suite) -> t.Table:
    note = (
        "Position errors are distances between predicted and true positions 1 to 4 s ahead, means "
        "over players. Half time: until the cosine error is half that of uniform weights. Rows in "
        "grey are no estimators: driving straight on, holding the controls, HighwayEnv's own "
        "drivers, a cloned policy, and the game at the true weights."
    )
    return t.table_of(
        table,
        _PLACE | _ERROR_COLUMNS,
        name="summary",
        note=note,
        quiet=lambda row: row["estimator"] in suite.references,
    )


def _comparisons(table: pd.DataFrame) -> t.Table:
    def verdict(row: t.Row) -> str:
        if not row["p_holm"] < SIGNIFICANCE:
            return "open"
        return "below" if row["wins"] > 0.5 else "above"

    columns: t.Columns = {
        "Verdict": verdict,
        **t.own("scenario", "sensor", "estimator"),
        "Against": lambda row: f"{'a third of ' * (row['factor'] < 1)}{row['other']}",
        "Error over the other's": "ratio",
        "Below on": t.share("wins"),
        "p (Holm)": t.p_value("p_holm"),
        "Motions": "pairs",
        "Draws": "units",
    }
    note = (
        "Position error 3 s ahead against a third of constant velocity's, and against fitted "
        "drivers where they were run, after the same samples. Below on: share of motions in "
        "which the error is smaller, with its 95 % interval. Paired tests over draws, adjusted "
        "after Holm."
    )
    return t.table_of(table, columns, name="comparisons", note=note)


def _latency(table: pd.DataFrame, suite: Suite) -> t.Table:
    deadline = suite.rules.deadline
    late = f"{deadline:g} s" if deadline else "the time until the next sample"
    note = (
        "Wall-clock time from handing out a sample to receiving the estimate. An update is late if "
        f"that is longer than {late}."
    )
    own = table[~table["estimator"].isin(suite.references)]
    return t.table_of(own, _PLACE | _LATENCY_COLUMNS, note=note)


def _drives(tables: Mapping[str, pd.DataFrame], suite: Suite) -> dict[str, Any]:
    summary = tables["summary"]
    tests = t.table_of(tables["tests"], _TEST_COLUMNS, name="tests", note=_TESTS)
    return {
        "title": f"{suite.name}: drives",
        "lead": lead_of(suite.description, _DRIVES_LEAD),
        "facts": [
            (int(summary.loc[summary["road"] != "all", "drives"].sum()), "drives"),
            (suite.rules.window, "samples in a window"),
        ],
        "sections": [("summary", "Cost and collisions"), ("provenance", "Provenance")],
        "board": _board(summary, suite),
        "more": [
            ("Paired tests", [tests]),
            ("Comfort and time", [t.table_of(summary, _DRIVE | _CYCLE_COLUMNS)]),
        ],
        "what": "All but times come out the same again, if no estimate is late:",
    }


def _board(summary: pd.DataFrame, suite: Suite) -> t.Table:
    note = (
        "Regret is the mean cost less that of the oracle in the same drives, in hundredths of what "
        "standing costs. Shares and regrets have 95 % intervals; all else are medians."
    )
    return t.table_of(
        summary,
        _DRIVE | _DRIVE_COLUMNS,
        name="summary",
        note=note,
        quiet=lambda row: row["planner"] in suite.references,
    )

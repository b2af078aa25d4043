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

_STREAMS = (
    "An estimator gets one sample after the other, and estimates after each. Medians and their "
    "95 % intervals are over motions, each of which counts by its median over samples."
)
_SUMMARY = (
    "Position errors are distances between predicted and true positions 1 to 4 s ahead, means over "
    "players. Half time: until the cosine error is half that of uniform weights. Rows in grey are "
    "no estimators: driving straight on, holding the controls, HighwayEnv's own drivers, a cloned "
    "policy, and the game at the true weights."
)
_COMPARISONS = (
    "Position error 3 s ahead against a third of constant velocity's, and against fitted drivers "
    "where they were run, after the same samples. Below on: share of motions in which the error is "
    "smaller, with its 95 % interval. Paired tests over draws, adjusted after Holm."
)
_LATENCY = (
    "Wall-clock time from handing out a sample to receiving the estimate. An update is late if "
    "that is longer than {}."
)
_DRIVES = (
    "Planners differ in the weights that they give the others; all begin at the same starts, with "
    "the same noise."
)
_REGRET = (
    "Regret is the mean cost less that of the oracle in the same drives, in hundredths of what "
    "standing costs. Shares and regrets have 95 % intervals; all else are medians."
)
_QUARTERS = (
    "Draws of each road, in four by the value of information: what a first plan for other "
    "plausible minds costs the ego more than the best one (quarter 4: most). Over all roads."
)
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
    return study_page(
        **(_streams(tables, suite) if suite.kind == "streams" else _drives(tables, suite)),
        pictures=[Markup(picture) for picture in pictures],
        command=repeats(runs[-1], suite),
        runs=list(runs),
        data={"tables": csv_texts(tables)},
    )


def _streams(tables: Mapping[str, pd.DataFrame], suite: Suite) -> dict[str, Any]:
    summary, references, deadline = tables["summary"], suite.references, suite.rules.deadline
    cells = summary.groupby(["scenario", "sensor", "sigma"])
    place: t.Columns = t.own("scenario", "sensor") | {"Noise": "sigma", "Estimator": "estimator"}
    errors: t.Columns = {
        "Cosine error": t.ends("cosine_error"),
        "Half time [s]": t.ends("half_time"),
        **{f"{ahead} s [m]": t.ends(f"fde_{ahead}s") for ahead in (1, 2, 3, 4)},
        "Motions": "motions",
        "Failed": t.share("failed"),
    }
    latency: t.Columns = {
        "Median [ms]": "latency_50",
        "95 % [ms]": "latency_95",
        "99 % [ms]": "latency_99",
        "Late": t.share("late"),
        "Updates": "updates",
    }
    compared: t.Columns = {
        "Verdict": _verdict,
        **t.own("scenario", "sensor", "estimator"),
        "Against": lambda row: f"{'a third of ' * (row['factor'] < 1)}{row['other']}",
        "Error over the other's": "ratio",
        "Below on": t.share("wins"),
        "p (Holm)": t.p_value("p_holm"),
        "Motions": "pairs",
        "Draws": "units",
    }
    comparisons = t.table_of(tables["comparisons"], compared, name="comparisons", note=_COMPARISONS)
    late = f"{deadline:g} s" if deadline else "the time until the next sample"
    estimators = summary[~summary["estimator"].isin(references)]
    times = t.table_of(estimators, place | latency, note=_LATENCY.format(late))
    return {
        "title": f"{suite.name}, one sample at a time",
        "lead": lead_of(suite.description, _STREAMS),
        "facts": [
            (int(cells["motions"].max().sum()), "motions"),
            (int(summary["updates"].sum()), "updates"),
            (suite.rules.lag or "all", "samples count"),
        ],
        "sections": [("summary", "Weights and predictions"), ("provenance", "Provenance")],
        "board": t.table_of(
            summary,
            place | errors,
            name="summary",
            note=_SUMMARY,
            quiet=lambda row: row["estimator"] in references,
        ),
        "more": [("Comparisons of predictions", [comparisons]), ("Latency", [times])],
        "what": "All but latencies come out the same again, if no update is late:",
    }


def _verdict(row: t.Row) -> str:
    if not row["p_holm"] < SIGNIFICANCE:
        return "open"
    return "below" if row["wins"] > 0.5 else "above"


_PAIRED: t.Columns = {
    "Less": "other",
    "Drives": "pairs",
    "Difference": "difference",
    "p (Holm)": t.p_value("p_holm"),
}


def _drives(tables: Mapping[str, pd.DataFrame], suite: Suite) -> dict[str, Any]:
    summary = tables["summary"]
    place: t.Columns = {**t.own("road", "traffic"), "Noise": "sigma", **t.own("planner", "drives")}
    results: t.Columns = {
        "Collisions [%]": t.ends("collision", 100),
        "Regret [%]": t.ends("regret", 100),
        "Progress [m]": "progress",
        "Error in 3 s [m]": "fde_3s",
    }
    comfort: t.Columns = {
        "Jerk [m/s³]": "jerk",
        "Cycle [ms]": "cycle_50",
        "99 % [ms]": "cycle_99",
        "Late": t.share("late"),
    }
    tested: t.Columns = {"What": "column", **t.own("road", "traffic", "planner"), **_PAIRED}
    if "road" not in tables["tests"]:  # contrasts
        tested = {"What": "column", "Quarter": "quarter", **t.own("planner")}
        tested |= _PAIRED
    tests = t.table_of(tables["tests"], tested, name="tests", note=_TESTS)
    more = [("Paired tests", [tests])]
    if "quarters" in tables:
        columns: t.Columns = {"Quarter": "quarter", **t.own("planner", "drives")}
        columns |= {name: results[name] for name in ("Collisions [%]", "Regret [%]")}
        columns |= {"Value [%]": t.ends("value", 100)}
        columns |= {name: comfort[name] for name in ("Cycle [ms]", "99 % [ms]")}
        quarters = t.table_of(tables["quarters"], columns, name="quarters", note=_QUARTERS)
        more.insert(0, ("By the value of information", [quarters]))
    return {
        "title": f"{suite.name}: drives",
        "lead": lead_of(suite.description, _DRIVES),
        "facts": [
            (int(summary.loc[summary["road"] != "all", "drives"].sum()), "drives"),
            (suite.rules.window, "samples in a window"),
        ],
        "sections": [("summary", "Cost and collisions"), ("provenance", "Provenance")],
        "board": t.table_of(
            summary,
            place | results,
            name="summary",
            note=_REGRET,
            quiet=lambda row: row["planner"] in suite.references,
        ),
        "more": [*more, ("Comfort and time", [t.table_of(summary, place | comfort)])],
        "what": "All but times come out the same again, if no estimate is late:",
    }

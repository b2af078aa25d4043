"""The page of a study of streams: errors over time, predictions, latencies."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import pandas as pd
from markupsafe import Markup

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.page import tables as t
from olne_bench.bench.report.page.template import csv_texts, lead_of, repeats, study_page
from olne_bench.bench.report.statistics.pairs import SIGNIFICANCE
from olne_bench.bench.run.provenance import Provenance

_LEAD = (
    "An estimator gets one sample after the other, and estimates after each. Medians and their "
    "95 % intervals are over motions, each of which counts by its median over samples."
)


@dataclass(frozen=True)
class OnlineTables:
    """Tables of ``bench.report.stream_tables``."""

    summary: pd.DataFrame
    over_time: pd.DataFrame
    comparisons: pd.DataFrame

    def by_name(self) -> dict[str, pd.DataFrame]:
        """The tables by the names of their files."""
        return dict(vars(self))


def online_page(
    tables: OnlineTables, pictures: Iterable[str], runs: Sequence[Provenance], suite: Suite
) -> str:
    """The page as HTML.

    Args:
        tables: tables of the run.
        pictures: SVG elements of its figures.
        runs: provenance of the rows, the latest run last.
        suite: suite of that run.
    """
    place: dict[str, t.Content] = {"Scenario": "scenario", "Sensor": "sensor", "Noise": "sigma"}
    place["Estimator"] = "estimator"
    cells = ["scenario", "sensor", "sigma"]
    return study_page(
        title=f"{suite.name}, one sample at a time",
        lead=lead_of(suite.description, _LEAD),
        facts=[
            (int(tables.summary.groupby(cells)["motions"].max().sum()), "motions"),
            (int(tables.summary["updates"].sum()), "updates"),
            (suite.rules.lag or "all", "samples count"),
        ],
        sections=[("summary", "Weights and predictions"), ("provenance", "Provenance")],
        board=_summary(tables.summary, place, suite),
        pictures=[Markup(picture) for picture in pictures],
        more=[
            ("Comparisons of predictions", [_comparisons(tables.comparisons)]),
            ("Latency", [_latency(tables.summary, place, suite)]),
        ],
        what="All but latencies come out the same again, if no update is late:",
        command=repeats(runs[-1], suite),
        runs=list(runs),
        data={"tables": csv_texts(tables.by_name())},
    )


def _summary(table: pd.DataFrame, place: dict[str, t.Content], suite: Suite) -> t.Table:
    errors: dict[str, t.Content] = {
        "Cosine error": t.ends("cosine_error"),
        "Half time [s]": t.ends("half_time"),
    }
    errors |= {f"{ahead} s [m]": t.ends(f"fde_{ahead}s") for ahead in (1, 2, 3, 4)}
    note = (
        "Position errors are distances between predicted and true positions 1 to 4 s ahead, means "
        "over players. Half time: until the cosine error is half that of uniform weights. Rows in "
        "grey are no estimators: driving straight on, holding the controls, HighwayEnv's own "
        "drivers, a cloned policy, and the game at the true weights."
    )
    return t.table_of(
        table,
        place | errors | {"Motions": "motions", "Failed": t.share("failed")},
        name="summary",
        note=note,
        quiet=lambda row: row["estimator"] in suite.references,
    )


def _comparisons(table: pd.DataFrame) -> t.Table:
    def verdict(row: t.Row) -> str:
        if not row["p_holm"] < SIGNIFICANCE:
            return "open"
        return "below" if row["wins"] > 0.5 else "above"

    columns: dict[str, t.Content] = {
        "Verdict": verdict,
        "Scenario": "scenario",
        "Sensor": "sensor",
        "Estimator": "estimator",
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


def _latency(table: pd.DataFrame, place: dict[str, t.Content], suite: Suite) -> t.Table:
    columns: dict[str, t.Content] = {
        "Median [ms]": "latency_50",
        "95 % [ms]": "latency_95",
        "99 % [ms]": "latency_99",
        "Late": t.share("late"),
        "Updates": "updates",
    }
    deadline = suite.rules.deadline
    late = f"{deadline:g} s" if deadline else "the time until the next sample"
    note = (
        "Wall-clock time from handing out a sample to receiving the estimate. An update is late if "
        f"that is longer than {late}."
    )
    own = table[~table["estimator"].isin(suite.references)]
    return t.table_of(own, place | columns, note=note)

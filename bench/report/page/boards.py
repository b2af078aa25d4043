"""What the page of a study of trials says of it: the verdict and all tables."""

from collections.abc import Sequence

import pandas as pd
from markupsafe import Markup

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.board import board_note, board_table, errors_of_board, tag
from olne_bench.bench.report.page import tables as t
from olne_bench.bench.report.statistics.identifiability import REFERENCE_SIGMA
from olne_bench.bench.report.statistics.score import ALL
from olne_bench.bench.report.study import FAILURES, Study, primary
from olne_bench.bench.report.tables import RunTables

_WEIGHT: t.Columns = t.own("sensor", "player", "weight")
#: Titles and tables of a section of a page.
Sections = list[tuple[str, list[t.Table]]]


def board(tables: RunTables, study: Study) -> t.Table:
    """The score table: a row for each estimator, over all scenarios."""
    shown: t.Columns = {
        "Estimator": lambda row: t.Cell(t.named(row["estimator"], tag(row, study))),
        "Score": t.ends("score"),
        **{head: name for name, head in errors_of_board(tables, study).items()},
        "Failures": lambda row: t.number(
            row["failures"],
            Markup("{:.0f}<small> / {:.0f}</small>").format(row["failures"], row["trials"]),
        ),
        "Time [ms]": "milliseconds",
    }
    rows = board_table(tables, study)
    note = board_note(rows, study)
    return t.table_of(rows, shown, name="scores", note=note, quiet=lambda row: row["floor"])


def all_numbers(
    tables: RunTables, metrics: Sequence[MetricDeclaration], study: Study
) -> list[t.Table]:
    """The leaderboard with these metrics, scores by error and by noise, estimators in pairs."""
    scores, labels = tables.scores, {m.name: m.label for m in study.metrics}
    error: t.Columns = {"Error": lambda row: labels.get(row["error"], row["error"])}
    pair: t.Columns = {"Estimator": "estimator", "Over": "other", "Ratio": t.ends("ratio")}
    scored: t.Columns = {"Estimator": "estimator", "Score": t.ends("score")}
    scored |= t.own("draws", "failures")
    first = getattr(primary(metrics), "name", "")
    return [
        t.table_of(
            tables.leaderboard,
            _board_columns(tables.leaderboard, metrics),
            name="leaderboard",
            title="Each scenario and sensor",
            note="Medians and quartiles over all trials; failures are infinitely wrong.",
            quiet=lambda row: study.is_floor(row["estimator"]),
        ),
        t.table_of(
            scores[(scores["scenario"] == ALL) & scores["sigma"].isna()],
            error | scored,
            title="Scores by each error",
        ),
        t.table_of(
            scores[scores["sigma"].notna() & (scores["error"] == first)],
            {"Noise [m]": "sigma", **scored},
            title="Scores by noise",
        ),
        t.table_of(
            tables.comparisons[tables.comparisons["scenario"] == ALL],
            error | pair | {"p (Holm)": t.p_value("p_holm"), "Draws": "draws"},
            name="comparisons",
            title="Estimators in pairs",
            note="Geometric means of the first's errors over the other's, over all scenarios, with "
            "95 % bootstrap intervals; permutation tests over draws, adjusted after Holm.",
        ),
    ]


def _board_columns(table: pd.DataFrame, metrics: Sequence[MetricDeclaration]) -> t.Columns:
    columns, first = t.own("scenario", "sensor", "estimator"), primary(metrics)
    if first and f"{first.name}_score" in table:
        columns["Score"] = t.ends(f"{first.name}_score")
    for metric in metrics:
        columns[metric.title] = f"{metric.name}_median"
        if metric.is_share:
            columns[metric.title] = t.share(f"{metric.name}_share")
        elif metric.compared:
            median, quartiles = f"{metric.name}_median", ("q25", "q75")
            columns[metric.title] = t.ends(median, of=metric.name, names=quartiles)
    if "refuted" in table and table["refuted"].notna().any():
        columns["No fit"] = t.share("refuted")
    columns |= {"Exact": t.share("exact"), "Error / bound": "limit_ratio"}
    columns["Failures"] = lambda row: t.number(
        row["failures"], f"{row['failures']} ({row['published_failures']}) / {row['trials']}"
    )
    for head, name in (("Harness errors", "harness_errors"), ("Implausible", "implausible")):
        if name in table and table[name].any():
            columns[head] = name
    return columns | {"Time [ms]": lambda row: t.number(1e3 * row["solve_seconds_median"])}


def changes_of(table: pd.DataFrame | None) -> Sections:
    """What got better or worse from one run to another."""
    if table is None:
        return []
    columns: t.Columns = {
        "Verdict": _marked,
        "Error": lambda row: row["error"].replace("_", " "),
        **t.own("scenario", "sensor"),
        "Estimator": _arrow,
        "First run": lambda row: _before(row, "before"),
        "Second run": lambda row: _before(row, "after"),
        "Ratio": "ratio",
        "Better on": t.share("better"),
        "p (Holm)": t.p_value("p_holm"),
        "Trials": "pairs",
    }
    note = (
        "The same trials of both runs, on the same noise. Better on: share of trials with a "
        "smaller error in the second run, with its 95 % interval; a tie counts half."
    )
    return [("What got better or worse", [t.table_of(table, columns, note=note)])]


def _marked(row: t.Row) -> t.Cell:
    mark = {"better": "yes", "worse": "no"}.get(row["verdict"], "quiet")
    return t.Cell(Markup('<span class="{}">{}</span>').format(mark, row["verdict"]))


def _arrow(row: t.Row) -> t.Cell:
    names = dict.fromkeys([row["estimator"], row["other"]])
    return t.Cell(Markup(" → ").join(map(t.broken, names)))


def _before(row: t.Row, column: str) -> t.Cell:
    failures = row["error"] == FAILURES.name
    return t.number(round(row[column] * row["pairs"]) if failures else row[column])


def details_of(tables: RunTables) -> Sections:
    """Tables of which the rows of one scenario are shown."""
    known = t.table_of(
        tables.identifiability,
        _WEIGHT
        | {"Identified": lambda row: "yes" if row["identified"] else "no"}
        | {"Left of the prior variance": t.share("left"), "Truth": "truth", "Bound ±": "bound"},
        name="identifiability",
        note=f"The Cramér-Rao bound of each true weight at a noise of {REFERENCE_SIGMA} m, "
        "compared with what is known without data. A weight is identified if its bound is below "
        "the standard deviation without data. The figure shows the same at this run's noise.",
        filtered=True,
    )
    ratios = t.table_of(
        tables.bound_ratios[tables.bound_ratios["identified"].astype(bool)],
        _WEIGHT | {"Estimator": "estimator", "Error / bound": "ratio"},
        name="bound_ratios",
        title="Errors of identified weights over the bound",
        note=f"Root mean squared errors, noise up to {REFERENCE_SIGMA} m; 1 is as good as it gets.",
        filtered=True,
    )
    levels: t.Columns = {**t.own("sensor", "estimator"), "σ [m]": "sigma", "Trials": "trials"}
    levels |= {f"{level} % regions": t.share(f"covered_{level}") for level in (50, 80, 95)}
    if "weights_95" in tables.calibration:
        levels["95 % of single weights"] = t.share("weights_95")
    calibration = t.table_of(
        tables.calibration,
        levels | {"p": t.p_value("p_uniform")},
        name="calibration",
        note="How often regions hold the truth, beside the level that they claim, with 95 % "
        "intervals. p is the chance of levels as uneven as these if all were calibrated.",
        filtered=True,
    )
    drivers = t.table_of(
        tables.temperaments[tables.temperaments["sigma"].isna()],
        t.own("sensor", "estimator", "temperament", "drivers")
        | {"Cosine error": "cosine_error_median", "Recognised": t.share("recognised")},
        name="temperaments",
        note="Drivers have temperaments, which estimators are not told. A driver is recognised if "
        "its estimated weights are most probable under its own temperament. All noise levels.",
        filtered=True,
    )
    found = [("What can be known of the weights", [known, ratios])]
    found += [("Calibration", [calibration])] if calibration.rows else []
    return [*found, ("Who drives", [drivers])] if drivers.rows else found

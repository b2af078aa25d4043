"""What the page of a study of trials says of it: the verdict and all tables."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from markupsafe import Markup

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.page import tables as t
from olne_bench.bench.report.statistics.identifiability import REFERENCE_SIGMA
from olne_bench.bench.report.statistics.score import (
    ALL,
    FEWEST_DRAWS,
    best_group,
    board_rows,
    in_order,
)
from olne_bench.bench.report.statistics.standing import listed
from olne_bench.bench.report.study import FAILURES, USUAL, Study, in_leaderboard, primary
from olne_bench.bench.report.tables import RunTables

_NOTHING = "No estimator has a score: that takes noise, and an estimator that ranks."
_WEIGHT: t.Columns = t.own("sensor", "player", "weight")
#: Titles and tables of a section of a page.
Sections = list[tuple[str, list[t.Table]]]


def verdict(scores: pd.DataFrame, comparisons: pd.DataFrame, study: Study = USUAL) -> str:
    """Which estimator has the smallest errors, by how much, and who cannot be told from it.

    ``scores`` is a ``score_table``, and ``comparisons`` the ``pair_table`` of the same trials.
    """
    boards = board_rows(scores, study)
    error, table = next(iter(boards.items()), ("", pd.DataFrame()))
    rows = table.to_dict("records")
    floors = [row for row in rows if study.is_floor(row["estimator"])]
    ranked = [row for row in rows if row["ranked"] and not study.is_floor(row["estimator"])]
    if not ranked:
        return _NOTHING
    best, *others = ranked
    label = next((m.label for m in study.metrics if m.name == error), error)
    number = best["scenarios"]
    where = f"{best['trials']} trials with noise" + f" of {number} scenarios" * (number > 1)
    if not others:
        return f"{best['estimator']} is the only estimator that ranks, on {where}."
    names = [str(row["estimator"]) for row in (best, *others)]
    pairs = comparisons[(comparisons["error"] == error) & (comparisons["scenario"] == ALL)]
    _, *ties = best_group(pairs, names)
    said = f"On {where}, {names[0]} has the smallest {label}s"
    if best["estimator"] == best["reference"]:
        said += f"; those of {names[1]} are {_change(others[0]['score'])}"
    else:
        said += f": {_change(best['score'])} than those of {best['reference']}{_interval(best)}"
    if best["draws"] < FEWEST_DRAWS:
        said += f"; {best['draws']} draws are too few to tell estimators apart"
    elif ties:
        said += f"; {listed(ties)} cannot be told apart from it"
    better = [row["estimator"] for row in floors if row["score"] < best["score"]]
    if better:
        said += f"; {better[0]}, which ignores the data, has smaller ones"
    return f"{said}."


def _change(ratio: float) -> str:
    return f"{100 * abs(ratio - 1):.0f} % {'smaller' if ratio <= 1 else 'larger'}"


def _interval(row: Mapping[Any, Any]) -> str:
    if pd.isna(row["score_low"]):
        return ""
    ends = [100 * (1 - row[name]) for name in ("score_high", "score_low")]
    return f" (95 % interval {ends[0]:.0f} to {ends[1]:.0f} %)"


def board(tables: RunTables, study: Study) -> t.Table:
    """The score table: a row for each estimator, over all scenarios."""
    boards, table = board_rows(tables.scores, study), tables.leaderboard
    first = primary(in_leaderboard(study.metrics, table))
    scored_rows = boards.get(first.name, pd.DataFrame()) if first else pd.DataFrame()
    rows = table.groupby("estimator").agg(
        all_failures=("failures", "sum"),
        all_trials=("trials", "sum"),
        seconds=("solve_seconds_median", "median"),
    )
    rows = rows.loc[style.estimator_order(table["estimator"].tolist())].reset_index()
    columns = ["estimator", "ranked", "score", "score_low", "score_high", "median"]
    columns += ["trials", "failures"]
    rows = rows.merge(scored_rows.reindex(columns=columns), on="estimator", how="left")
    if "held_out_error" in boards:
        held = boards["held_out_error"][["estimator", "median"]]
        rows = rows.merge(held.rename(columns={"median": "held"}), on="estimator", how="left")
    rows = in_order(rows, study)
    reference = scored_rows["reference"].iloc[0] if len(scored_rows) else ""
    shown: t.Columns = {
        "Estimator": lambda row: t.Cell(t.named(row["estimator"], _tag(row, study))),
        "Score": t.ends("score"),
        first.title if first else "Error": "median",
        "Held-out error [m]": "held",
        "Failures": _failed,
        "Time [ms]": lambda row: t.number(1e3 * row["seconds"]),
    }
    note = (
        f"Score: geometric mean of {first.label} over that of {reference} in the same trials with "
        "noise, with its 95 % bootstrap interval over draws; 0.79 is 21 % smaller. A failure "
        "counts as the error of uniform. Errors are medians over the same trials. Those marked "
        "'prior' know how true weights are drawn; floors do not rank."
        if first and reference
        else "Nobody has a score."
    )
    return t.table_of(rows, shown, name="scores", note=note, quiet=lambda row: row["floor"])


def _tag(row: t.Row, study: Study) -> str:
    if row["floor"]:
        return "floor"
    tags = ["prior"] * study.knows_prior(row["estimator"])
    return ", ".join([*tags, *["unranked"] * row["unranked"]])


def _failed(row: t.Row) -> t.Cell:
    known = not math.isnan(row["score"])
    failed, trials = (row[f"{'' if known else 'all_'}{n}"] for n in ("failures", "trials"))
    return t.number(failed, Markup("{:.0f}<small> / {:.0f}</small>").format(failed, trials))


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
    columns |= {"Exact": t.share("exact"), "× bound": "limit_ratio"}
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
    found = [("What can be known of the weights", [known, ratios])]
    if len(tables.calibration):
        found.append(("Calibration", [_calibration(tables.calibration)]))
    if len(tables.temperaments):
        found.append(("Who drives", [_drivers(tables.temperaments)]))
    return found


def _calibration(table: pd.DataFrame) -> t.Table:
    weights = {"95 % of single weights": t.share("weights_95")} if "weights_95" in table else {}
    columns: t.Columns = {
        **t.own("sensor", "estimator"),
        "σ [m]": "sigma",
        "Trials": "trials",
        **{f"{level} % regions": t.share(f"covered_{level}") for level in (50, 80, 95)},
        **weights,
        "p": t.p_value("p_uniform"),
    }
    note = (
        "How often regions hold the truth, beside the level that they claim, with 95 % intervals. "
        "p is the chance of levels as uneven as these if all were calibrated."
    )
    return t.table_of(table, columns, name="calibration", note=note, filtered=True)


def _drivers(table: pd.DataFrame) -> t.Table:
    whole = table[table["sigma"].isna()]
    columns = t.own("sensor", "estimator", "temperament", "drivers")
    columns |= {"Cosine error": "cosine_error_median", "Recognised": t.share("recognised")}
    note = (
        "Drivers have temperaments, which estimators are not told. A driver is recognised if its "
        "estimated weights are most probable under its own temperament. All noise levels."
    )
    return t.table_of(whole, columns, name="temperaments", note=note, filtered=True)

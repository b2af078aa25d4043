"""The page of a study of trials: verdict, a scene that plays, the score, figures and all tables."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd
from markupsafe import Markup

from olne_bench.bench.judge.metrics.declaration import MetricDeclaration
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.measures import FAILURES, in_leaderboard, primary
from olne_bench.bench.report.not_drawn import NotDrawnError
from olne_bench.bench.report.page import tables as t
from olne_bench.bench.report.page.cards import card_of
from olne_bench.bench.report.page.scenes import scene_data
from olne_bench.bench.report.page.template import csv_texts, lead_of, study_page
from olne_bench.bench.report.page.verdict import verdict
from olne_bench.bench.report.parts import Parts, of_each, parts_of
from olne_bench.bench.report.scenes import Place
from olne_bench.bench.report.statistics.harness_errors import in_words
from olne_bench.bench.report.statistics.identifiability import REFERENCE_SIGMA
from olne_bench.bench.report.statistics.score import ALL, board_rows, in_order
from olne_bench.bench.report.statistics.standing import said_of_standing
from olne_bench.bench.report.study import USUAL, Study
from olne_bench.bench.report.tables import RunTables
from olne_bench.bench.run.provenance import Provenance
from olne_bench.envs.worlds.scene import PLAYER_COLOURS

_LEAD = (
    "Several vehicles play a Nash equilibrium. From noisy, partial observations, each estimator "
    "infers what every vehicle wants, and from that predicts how all of them move."
)
_PLACE: dict[str, t.Content] = {
    "Scenario": "scenario",
    "Sensor": "sensor",
    "Estimator": "estimator",
}


@dataclass(frozen=True)
class Extras:
    """Optional parts of a page.

    Attributes:
        title: title. Default: the suite's name.
        playable: noise levels and seeds of sequences that must be playable.
        changes: table of ``bench.report.statistics.run_comparison``, for a page of two runs.
        pictures: SVG elements by scenario and kind, from ``bench.report.figures``.
    """

    title: str = ""
    playable: tuple[Place, ...] = ()
    changes: pd.DataFrame | None = None
    pictures: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


PLAIN = Extras()


@dataclass(frozen=True)
class Page:
    """The page.

    Attributes:
        html: the HTML text.
        notes: what it cannot show, and why.
    """

    html: str
    notes: list[str]


def render_page(
    trials: pd.DataFrame | Parts,
    tables: RunTables,
    runs: Sequence[Provenance],
    study: Study = USUAL,
    notes: Sequence[str] = (),
    extras: Extras = PLAIN,
) -> Page:
    """The page as HTML.

    Args:
        trials: rows of a run.
        tables: tables of these rows.
        runs: provenance of the rows, the latest run last.
        study: study of the run.
        notes: further notes for the page, on what could not be shown.
        extras: optional parts.
    """
    parts, table = parts_of(trials), tables.leaderboard
    labels = style.estimator_order(table["estimator"].tolist())
    scenes, lost = _scenes(parts, study, extras)
    metrics = in_leaderboard(study.metrics, table)
    html = study_page(
        title=extras.title or parts.outline.suite,
        lead=lead_of(_description(runs), _LEAD),
        facts=_facts(tables, parts, runs),
        sections=[("scene", "Scene"), ("board", "Score"), ("figures", "Figures")],
        verdict=verdict(tables.scores, tables.comparisons, study),
        scenes=True,
        scenarios=parts.outline.scenarios,
        board=board(tables, study),
        remarks=said_of_standing(table),
        pictures=[Markup(p) for p in extras.pictures.get("", {}).values()],
        more=[*_changes(extras.changes), ("All numbers", _all_numbers(tables, metrics, study))],
        drawn=bool(extras.pictures),
        details=_details(tables),
        cards=[card_of(study.estimators[name]) for name in labels if name in study.estimators],
        missing=_missing(tables, [*notes, *lost]),
        runs=list(runs),
        data=_data(parts, study, scenes, extras)
        | {"tables": csv_texts(tables.by_name())}
        | {"estimators": [{"name": n, "colours": style.estimator_colours(n)} for n in labels]},
    )
    return Page(html, lost)


def _description(runs: Sequence[Provenance]) -> str:
    """The suite's description, if it is known."""
    return str(json.loads(runs[-1].suite).get("description", "")) if runs else ""


def _facts(tables: RunTables, parts: Parts, runs: Sequence[Provenance]) -> list[tuple[Any, str]]:
    number = len(parts.outline.scenarios)
    facts: list[tuple[Any, str]] = [
        (f"{int(tables.leaderboard['trials'].sum()):,}", "trials"),
        (number, "scenarios" if number != 1 else "scenario"),
        (tables.leaderboard["estimator"].nunique(), "estimators"),
    ]
    if runs:
        commit = runs[-1].commit
        dirty = "-dirty" if commit.endswith("-dirty") else ""
        facts.append((runs[-1].started[:10], f"commit {commit[:10]}{dirty}" if commit else ""))
    return facts


def _missing(tables: RunTables, notes: Sequence[str]) -> list[str]:
    wrong = in_words(tables.harness_errors)
    head = (
        ["The harness itself failed in these trials, which do not count as attempts:"]
        if wrong
        else []
    )
    return list(dict.fromkeys([*head, *wrong, *notes]))


def _scenes(
    parts: Parts, study: Study, extras: Extras
) -> tuple[list[dict[str, Any] | None], list[str]]:
    """The scenes of all scenarios, as far as they can be played, and why not."""
    number, lost = len(parts.outline.scenarios), []

    def scene(name: str, own: pd.DataFrame) -> dict[str, Any] | None:
        try:
            return scene_data(own, number=number, study=study, wanted=extras.playable)
        except NotDrawnError as error:
            lost.append(f"trajectories of {name} on the page: {error}")
            return None

    return of_each(parts, scene), lost


def _data(
    parts: Parts, study: Study, scenes: Sequence[dict[str, Any] | None], extras: Extras
) -> dict[str, Any]:
    """What the script shows."""
    metrics = [m for m in parts.outline.metrics(study.metrics) if not m.is_share]
    sensors = style.sensor_order(parts.outline.cells["sensor"].tolist())
    return {
        "metrics": [
            {"name": m.name, "title": m.title, "prediction": m.needs_prediction} for m in metrics
        ],
        "sensors": sensors,
        "players": PLAYER_COLOURS,
        "scenarios": [
            {"name": name, "scene": scene, "pictures": dict(extras.pictures.get(name, {}))}
            for name, scene in zip(parts.outline.scenarios, scenes, strict=True)
        ],
    }


def board(tables: RunTables, study: Study) -> t.Table:
    """The score table: a row for each estimator, over all scenarios."""
    boards, table = board_rows(tables.scores, study), tables.leaderboard
    first = primary(in_leaderboard(study.metrics, table))
    scored_rows = boards.get(first.name, pd.DataFrame()) if first else pd.DataFrame()
    rows = pd.DataFrame({"estimator": style.estimator_order(table["estimator"].tolist())})
    whole = table.groupby("estimator").agg(
        all_failures=("failures", "sum"),
        all_trials=("trials", "sum"),
        seconds=("solve_seconds_median", "median"),
    )
    rows = rows.merge(whole.reset_index(), on="estimator")
    columns = ["estimator", "ranked", "score", "score_low", "score_high", "median"]
    columns += ["trials", "failures"]
    rows = rows.merge(scored_rows.reindex(columns=columns), on="estimator", how="left")
    if "held_out_error" in boards:
        held = boards["held_out_error"][["estimator", "median"]]
        rows = rows.merge(held.rename(columns={"median": "held"}), on="estimator", how="left")
    rows = in_order(rows, study)
    reference = scored_rows["reference"].iloc[0] if len(scored_rows) else ""
    shown: dict[str, t.Content] = {
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


def _all_numbers(
    tables: RunTables, metrics: Sequence[MetricDeclaration], study: Study
) -> list[t.Table]:
    scores, labels = tables.scores, {m.name: m.label for m in study.metrics}
    error: dict[str, t.Content] = {"Error": lambda row: labels.get(row["error"], row["error"])}
    counted: dict[str, t.Content] = {"Draws": "draws", "Failures": "failures"}
    whole = scores[(scores["scenario"] == ALL) & scores["sigma"].isna()]
    first = primary(metrics)
    by_noise = scores[scores["sigma"].notna() & (scores["error"] == getattr(first, "name", ""))]
    pairs = tables.comparisons[tables.comparisons["scenario"] == ALL]
    named: dict[str, t.Content] = {"Estimator": "estimator"}
    return [
        t.table_of(
            tables.leaderboard,
            _PLACE | _board_columns(tables.leaderboard, metrics),
            name="leaderboard",
            title="Each scenario and sensor",
            note="Medians and quartiles over all trials; failures are infinitely wrong.",
            quiet=lambda row: study.is_floor(row["estimator"]),
        ),
        t.table_of(
            whole,
            error | named | {"Score": t.ends("score")} | counted,
            title="Scores by each error",
        ),
        t.table_of(
            by_noise,
            {"Noise [m]": "sigma"} | named | {"Score": t.ends("score")} | counted,
            title="Scores by noise",
        ),
        t.table_of(
            pairs,
            error
            | {"Estimator": "estimator", "Over": "other"}
            | {"Ratio": t.ends("ratio"), "p (Holm)": t.p_value("p_holm"), "Draws": "draws"},
            name="comparisons",
            title="Estimators in pairs",
            note="Geometric means of the first's errors over the other's, over all scenarios, with "
            "95 % bootstrap intervals; permutation tests over draws, adjusted after Holm.",
        ),
    ]


def _board_columns(
    table: pd.DataFrame, metrics: Sequence[MetricDeclaration]
) -> dict[str, t.Content]:
    columns: dict[str, t.Content] = {}
    first = primary(metrics)
    if first and f"{first.name}_score" in table:
        columns["Score"] = t.ends(f"{first.name}_score")
    for metric in metrics:
        columns[metric.title] = (
            t.share(f"{metric.name}_share")
            if metric.is_share
            else t.ends(f"{metric.name}_median", of=metric.name, names=("q25", "q75"))
            if metric.compared
            else f"{metric.name}_median"
        )
    columns |= {"Exact": t.share("exact"), "× bound": "limit_ratio"}
    columns["Failures"] = lambda row: t.number(
        row["failures"], f"{row['failures']} ({row['published_failures']}) / {row['trials']}"
    )
    for head, name in (("Harness errors", "harness_errors"), ("Implausible", "implausible")):
        if name in table and table[name].any():
            columns[head] = name
    return columns | {"Time [ms]": lambda row: t.number(1e3 * row["solve_seconds_median"])}


def _changes(table: pd.DataFrame | None) -> list[tuple[str, list[t.Table]]]:
    """What got better or worse from one run to another."""
    if table is None:
        return []
    marks = {"better": "yes", "worse": "no"}
    columns: dict[str, t.Content] = {
        "Verdict": lambda row: t.Cell(
            Markup('<span class="{}">{}</span>').format(
                marks.get(row["verdict"], "quiet"), row["verdict"]
            )
        ),
        "Error": lambda row: row["error"].replace("_", " "),
        "Scenario": "scenario",
        "Sensor": "sensor",
        "Estimator": lambda row: t.Cell(_arrow(row)),
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


def _arrow(row: t.Row) -> Markup:
    same = row["other"] == row["estimator"]
    return t.broken(row["estimator"]) + (Markup() if same else " → " + t.broken(row["other"]))


def _before(row: t.Row, column: str) -> t.Cell:
    if row["error"] == FAILURES.name:
        return t.number(round(row[column] * row["pairs"]))
    return t.number(row[column])


def _details(tables: RunTables) -> list[tuple[str, list[t.Table]]]:
    """Tables of which the rows of one scenario are shown."""
    weight: dict[str, t.Content] = {"Sensor": "sensor", "Player": "player", "Weight": "weight"}
    known = t.table_of(
        tables.identifiability,
        weight
        | {"Identified": lambda row: "yes" if row["identified"] else "no"}
        | {"Left of the prior variance": t.share("left")}
        | {"Truth": "truth", "Bound ±": "bound"},
        name="identifiability",
        note=f"The Cramér-Rao bound of each true weight at a noise of {REFERENCE_SIGMA} m, "
        "compared with what is known without data. A weight is identified if its bound is below "
        "the standard deviation without data. The figure shows the same at this run's noise.",
        filtered=True,
    )
    ratios = t.table_of(
        tables.bound_ratios[tables.bound_ratios["identified"].astype(bool)],
        weight | {"Estimator": "estimator", "Error / bound": "ratio"},
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
    columns: dict[str, t.Content] = {"Sensor": "sensor", "Estimator": "estimator"}
    columns |= {"σ [m]": "sigma", "Trials": "trials"}
    columns |= {f"{level} % regions": t.share(f"covered_{level}") for level in (50, 80, 95)}
    if "weights_95" in table:
        columns["95 % of single weights"] = t.share("weights_95")
    columns["p"] = t.p_value("p_uniform")
    note = (
        "How often regions hold the truth, beside the level that they claim, with 95 % intervals. "
        "p is the chance of levels as uneven as these if all were calibrated."
    )
    return t.table_of(table, columns, name="calibration", note=note, filtered=True)


def _drivers(table: pd.DataFrame) -> t.Table:
    whole = table[table["sigma"].isna()]
    columns: dict[str, t.Content] = {
        "Sensor": "sensor",
        "Estimator": "estimator",
        "Temperament": "temperament",
        "Drivers": "drivers",
        "Cosine error": "cosine_error_median",
        "Recognised": t.share("recognised"),
    }
    note = (
        "Drivers have temperaments, which estimators are not told. A driver is recognised if its "
        "estimated weights are most probable under its own temperament. All noise levels."
    )
    return t.table_of(whole, columns, name="temperaments", note=note, filtered=True)

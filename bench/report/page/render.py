"""The page of a study of trials: verdict, a scene that plays, the score, figures and all tables."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from olne_bench.bench.judge.scene import NoSceneError, Scenes, TrueScene
from olne_bench.bench.report.board import verdict
from olne_bench.bench.report.figures import style
from olne_bench.bench.report.formats import NotDrawnError
from olne_bench.bench.report.page.boards import all_numbers, board, changes_of, details_of
from olne_bench.bench.report.page.cards import card_of
from olne_bench.bench.report.page.scenes import scene_data
from olne_bench.bench.report.page.template import csv_texts, lead_of, study_page
from olne_bench.bench.report.parts import Parts, of_each, parts_of
from olne_bench.bench.report.scenes import Place
from olne_bench.bench.report.statistics.attempts import FLOOR, in_words, weighed
from olne_bench.bench.report.statistics.standing import said_of_standing
from olne_bench.bench.report.study import USUAL, Study, in_leaderboard
from olne_bench.bench.report.tables import RunTables, tabulate
from olne_bench.bench.run.provenance import Provenance
from olne_bench.envs.worlds.scene import PLAYER_COLOURS

_LEAD = (
    "Several vehicles play a Nash equilibrium. From noisy, partial observations, each estimator "
    "infers what every vehicle wants, and from that predicts how all of them move."
)
_SPOILT = "The harness itself failed in these trials, which do not count as attempts:"

#: SVG elements by scenario and kind; those of all scenarios have the scenario "".
Pictures = Mapping[str, Mapping[str, str]]
#: A run's name, trials and provenance.
Run = tuple[str, pd.DataFrame, Sequence[Provenance]]
_TRIAL = ["scenario", "sensor", "sigma", "seed"]


@dataclass(frozen=True)
class Page:
    """The page as HTML, and what it cannot show, and why."""

    html: str
    notes: list[str]


def render_page(
    trials: pd.DataFrame | Parts,
    tables: RunTables,
    runs: Sequence[Provenance],
    study: Study = USUAL,
    notes: Sequence[str] = (),
    *,
    title: str = "",
    playable: Sequence[Place] = (),
    changes: pd.DataFrame | None = None,
    pictures: Pictures = MappingProxyType({}),
) -> Page:
    """The page of trials and their tables, by default with the suite's name as its ``title``.

    The last run is the latest. ``notes`` say what else is not shown; ``playable`` sequences can be
    played; ``changes`` are those of ``compare_runs``; ``pictures`` are SVG elements.
    """
    parts, table = parts_of(trials), tables.leaderboard
    labels = style.estimator_order(table["estimator"].tolist())
    data, lost = _data(parts, study, playable, pictures)
    metrics = in_leaderboard(study.metrics, table)
    suite = json.loads(runs[-1].suite) if runs else {}
    wrong = in_words(tables.harness_errors)
    html = study_page(
        title=title or parts.outline.suite,
        lead=lead_of(suite.get("description", ""), _LEAD),
        facts=_facts(tables, parts, runs),
        sections=[("scene", "Scene"), ("board", "Score"), ("figures", "Figures")],
        verdict=verdict(tables.scores, tables.comparisons, study),
        scenes=True,
        scenarios=parts.outline.scenarios,
        board=board(tables, study),
        remarks=said_of_standing(table),
        pictures=[Markup(p) for p in pictures.get("", {}).values()],
        more=[*changes_of(changes), ("All numbers", all_numbers(tables, metrics, study))],
        drawn=bool(pictures),
        details=details_of(tables),
        cards=[card_of(study.estimators[name]) for name in labels if name in study.estimators],
        missing=list(dict.fromkeys([*([_SPOILT] if wrong else []), *wrong, *notes, *lost])),
        runs=list(runs),
        data=data
        | {"tables": csv_texts(tables.by_name())}
        | {"estimators": [{"name": n, "colours": style.estimator_colours(n)} for n in labels]},
    )
    return Page(html, lost)


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


def _data(
    parts: Parts, study: Study, playable: Sequence[Place], pictures: Pictures
) -> tuple[dict[str, Any], list[str]]:
    """What the script shows, with the scenes that can be played, and why others cannot."""
    number, lost = len(parts.outline.scenarios), []

    def scenario(name: str, own: pd.DataFrame) -> dict[str, Any]:
        scene = None
        try:
            scene = scene_data(own, number=number, study=study, wanted=playable)
        except NotDrawnError as error:
            lost.append(f"trajectories of {name} on the page: {error}")
        return {"name": name, "scene": scene, "pictures": dict(pictures.get(name, {}))}

    data = {
        "metrics": [
            {"name": m.name, "title": m.title, "prediction": m.needs_prediction}
            for m in parts.outline.metrics(study.metrics)
            if not m.is_share
        ],
        "sensors": style.sensor_order(parts.outline.cells["sensor"].tolist()),
        "players": PLAYER_COLOURS,
        "scenarios": of_each(parts, scenario),
    }
    return data, lost


def two_runs_page(
    first: Run, second: Run, names: Mapping[str, str], changes: pd.DataFrame, study: Study
) -> str:
    """The page of two runs as HTML, as of a run in which the second's estimators are renamed.

    ``names`` are the labels of estimators in the first run, and in the second.
    """
    (name, old, sources), (other, new, others) = first, second
    renamed = {label: after_name(label, names) for label in names.values()}
    old, new = old[old["estimator"].isin(names)], new[new["estimator"].isin(renamed)]
    shared = old[_TRIAL].drop_duplicates().merge(new[_TRIAL].drop_duplicates())
    # The floor is the same in both runs, and is recognised by its name.
    new = new.assign(estimator=new["estimator"].map(renamed))
    new = new[new["estimator"] != FLOOR]
    trials = pd.concat([table.merge(shared) for table in (old, new)], ignore_index=True)
    later = {renamed[n]: study.estimators[n] for n in renamed if n in study.estimators}
    whole = replace(study, estimators={**study.estimators, **later})
    tables = tabulate(weighed(trials), whole)
    notes = [f"only the trials that both {name} and {other} have are on this page", *tables.notes]
    title, runs = f"{name} and {other}", [*sources, *others]
    return render_page(trials, tables, runs, whole, notes, title=title, changes=changes).html


@dataclass(frozen=True)
class ScenesOfBoth:
    """Truths and motions of two runs."""

    first: Scenes
    second: Scenes  # none, if its draws are not those of the first run
    renamed: Mapping[str, str]  # names of its estimators on the page, and their labels there

    def truth(self, scenario: str, seed: int, sensor: str | None = None) -> TrueScene:
        try:
            return self.first.truth(scenario, seed, sensor)
        except NoSceneError:
            return self.second.truth(scenario, seed, sensor)

    def motion(self, trial: Mapping[Any, Any], shape: tuple[int, ...]) -> np.ndarray | None:
        label = self.renamed.get(trial["estimator"])
        if label is None:
            return self.first.motion(trial, shape)
        return self.second.motion({**trial, "estimator": label}, shape)


def after_name(label: str, names: Mapping[str, str]) -> str:
    """The name of a second run's estimator on the page."""
    return f"{label} (second)" if label in names and label != FLOOR else label

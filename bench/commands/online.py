"""``olne-bench online``: run a suite's trials as motions that go on, one sample at a time."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import click
import pandas as pd

from olne_bench.bench.commands.going_on import StudyOptions, go_on, leave
from olne_bench.bench.commands.online_rules import keep_rules
from olne_bench.bench.judge.online import ERROR_COLUMNS
from olne_bench.bench.plan.draws import draws_source
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.motion import (
    REFERENCES,
    Motion,
    OnlineRules,
    motions,
    with_references,
)
from olne_bench.bench.plan.salt import check_salt
from olne_bench.bench.plan.select import select
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import foreign_worlds
from olne_bench.bench.report.online_rows import update_table
from olne_bench.bench.report.write_online import write_online
from olne_bench.bench.run.cluster import check_cluster
from olne_bench.bench.run.describing import describe_all
from olne_bench.bench.run.excluding import check_priors
from olne_bench.bench.run.store import open_store
from olne_bench.bench.run.store_layout import MOTIONS_NAME
from olne_bench.envs.recording import NoEquilibriumError
from olne_bench.envs.scenarios import get_scenario
from olne_bench.errors import UserError

#: Columns of the summary that are shown, in the order of the terminal.
_SHOWN = ["motions", "failed", "late", "latency_50", "latency_99", "cosine_error", "half_time"]


@dataclass(frozen=True, kw_only=True)
class OnlineOptions(StudyOptions):
    """The options of ``olne-bench online``."""

    lag: int | None
    deadline: float | None
    fit_stock: int | None

    @property
    def rules(self) -> OnlineRules:
        """The rules of the study."""
        return OnlineRules(self.lag, self.deadline, self.fit_stock)


def online(suite: str, **options: Any) -> None:
    """Run SUITE, a name or a TOML file, one sample at a time."""
    chosen = OnlineOptions(suite=suite, **options)
    rules = chosen.rules
    check_salt(chosen.salt)
    own = load_suite(suite, chosen.plugin, partial(describe_all, hidden=chosen.out))
    draws_source(suite, own)  # refused before anything is written
    part = select(own, chosen.selection)
    check_online(part, rules.lag)
    check_priors(part, chosen.out)
    if chosen.dask is not None:
        check_cluster(chosen.dask)
    whole = with_references(own, rules)
    if chosen.estimator:  # what they are compared with is run all the same
        references = [e.label for e in whole.estimators if e.label in REFERENCES]
        chosen = replace(chosen, estimator=(*references, *chosen.estimator))
    with open_store(chosen.out, MOTIONS_NAME) as store:
        keep_rules(chosen.out, whole, rules, begun=bool(store.runs()))
        interrupted = go_on(whole, chosen, store, partial(_expanded, rules))
        leave(interrupted)
        rows, runs = update_table(store, whole), store.runs()
    _say(rows, write_online(rows, runs, rules, chosen.out, figures=chosen.figures).summary)
    click.echo(f"{chosen.out}: index.html is the page, updates.csv has a row for each sample")


def _expanded(rules: OnlineRules, suite: Suite, seeds: int | None) -> Iterator[Motion]:
    return motions(suite, rules, seeds)


def check_online(suite: Suite, lag: int | None) -> None:
    """Refuse what cannot be run one sample at a time.

    Raises:
        UserError: on several trajectories, on scenarios and sensors that are plugins, on
            estimators that are called like what they are compared with, and on a lag longer than a
            motion.
    """
    for estimator in suite.estimators:
        if estimator.label in REFERENCES:
            raise UserError(
                f"an estimator is called {estimator.label!r}; online, that is what estimators are "
                "compared with: give it another label"
            )
    for scenario in suite.scenarios:
        if scenario.trajectories > 1:
            raise UserError(
                f"scenario {scenario.label!r} has {scenario.trajectories} trajectories; online, "
                "there is one motion at a time"
            )
        for sensor in suite.sensors:
            if foreign := foreign_worlds(scenario, sensor):
                raise UserError(
                    f"{foreign[0]!r} is a plugin; online, scenarios and sensors are built-in ones"
                )
        if lag is not None:
            _check_lag(scenario, lag)


def _check_lag(scenario: ScenarioEntry, lag: int) -> None:
    with suppress(NoEquilibriumError):  # another draw may be played
        samples = get_scenario(scenario.name, 0, **scenario.options).game.horizon
        if lag > samples:  # all draws have as many
            raise UserError(
                f"--lag {lag}: a motion of scenario {scenario.label!r} has {samples} samples; use "
                "fewer, or no --lag for all so far"
            )


def _say(rows: pd.DataFrame, summary: pd.DataFrame) -> None:
    labels = ["scenario", "sigma", "estimator"]
    predictions = [name for name in ERROR_COLUMNS if name.startswith("fde_")]
    shown = summary[[*labels, *_SHOWN, *predictions]]
    click.echo("medians; latency in ms, half_time in s, errors of positions (fde) in m")
    click.echo(shown.to_string(index=False, float_format=lambda value: f"{value:.3g}", na_rep="-"))
    failed = rows[rows["status"] != "ok"]
    failed = failed[~failed["estimator"].isin(REFERENCES)]
    for (status, message), part in failed.groupby(["status", "message"]):
        click.echo(f"{len(part)} rows {status}: {message}", err=True)

"""``olne-bench online``: run a suite's trials as motions that go on, one sample at a time."""

import csv
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path

import click
import msgspec
import pandas as pd
from tqdm import tqdm

from olne_bench.bench.commands.options import PATH, PLUGIN, FiniteRange, memory_option
from olne_bench.bench.judge.online import ERROR_COLUMNS, REFERENCES, OnlineRules
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.salt import check_salt, salted
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import Trial, expand, foreign_worlds, number_of_trials
from olne_bench.bench.report.figures.online import draw_online
from olne_bench.bench.report.online import over_time_table, summary_table
from olne_bench.bench.run.describing import describe_all
from olne_bench.bench.run.excluding import check_priors
from olne_bench.bench.run.online import COLUMNS, run_online
from olne_bench.errors import UserError
from olne_bench.estimators.stream import LEAST_LAG
from olne_bench.files import whole_file

#: Files of an online study.
SETTINGS, UPDATES, SUMMARY, OVER_TIME = "online.json", "updates.csv", "summary.csv", "over_time.csv"

#: Columns of the summary that are shown, in the order of the terminal.
_SHOWN = ["motions", "failed", "late", "latency_50", "latency_99", "cosine_error", "half_time"]


@click.command()
@click.argument("suite", default="online")
@click.option("--out", type=PATH, required=True, help="New folder for the tables.")
@click.option(
    "--lag",
    type=click.IntRange(min=LEAST_LAG),
    help="Number of latest samples that count. Default: all so far.",
)
@click.option(
    "--deadline",
    type=FiniteRange(min=1e-3),
    help="Time in which an update has to end [s]. Default: until the next sample.",
)
@memory_option("Memory limit of the player process.")
@click.option("--scenario", multiple=True, help="Only this scenario (repeatable).")
@click.option("--sensor", multiple=True, help="Only this sensor (repeatable).")
@click.option("--estimator", multiple=True, help="Only this estimator (repeatable).")
@click.option("--sigma", type=float, multiple=True, help="Only this noise level (repeatable).")
@click.option("--seeds", type=click.IntRange(1, 10**8), help="Use only the first draws, this many.")
@click.option("--salt", metavar="TEXT", help="Text that seeds noise and draws.")
@click.option(
    "--plugin",
    type=PLUGIN,
    multiple=True,
    metavar="FILE.py[:CLASS]",
    help="Add an estimator from a file (repeatable).",
)
@click.option("--figures/--no-figures", default=True, show_default=True, help="Draw figures.")
def online(
    suite: str,
    out: Path,
    lag: int | None,
    deadline: float | None,
    memory: float,
    scenario: tuple[str, ...],
    sensor: tuple[str, ...],
    estimator: tuple[str, ...],
    sigma: tuple[float, ...],
    seeds: int | None,
    salt: str | None,
    plugin: tuple[str, ...],
    figures: bool,
) -> None:
    """Run SUITE, a name or a TOML file, one sample at a time.

    An estimator gets one sample after the other and estimates after each. An update that ends after
    the next sample is late, and the former estimate counts for that sample. One motion runs at a
    time, so that latencies are those of one core.
    """
    check_salt(salt)
    if out.exists():
        raise UserError(f"--out {out} exists already; name another folder")
    whole = load_suite(suite, plugin, partial(describe_all, hidden=out))
    selection = Selection.model_construct(
        scenarios=scenario, sensors=sensor, sigmas=sigma, estimators=estimator, seeds=seeds
    )
    chosen = salted(select(whole, selection), salt, None)
    _check(chosen)
    check_priors(chosen, out)
    rules = OnlineRules(lag, deadline)
    out.mkdir(parents=True)
    settings = {"suite": chosen.model_dump(mode="json"), "seeds": seeds} | asdict(rules)
    (out / SETTINGS).write_bytes(msgspec.json.format(msgspec.json.encode(settings), indent=1))
    _run(chosen, seeds, rules, int(memory * 2**30), out.resolve())
    rows = pd.read_csv(out / UPDATES)
    _write_tables(rows, out)
    if figures:
        draw_online(rows, out)
        click.echo(f"{out}: online_*.png and .svg show errors over time")


def _check(suite: Suite) -> None:
    """Refuse what cannot be run one sample at a time.

    Raises:
        UserError: on several trajectories, and on scenarios and sensors that are plugins.
    """
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


def _run(suite: Suite, seeds: int | None, rules: OnlineRules, memory: int, out: Path) -> None:
    """Write the rows of all motions as they come."""

    def trials() -> Iterator[Trial]:
        with tqdm(
            total=number_of_trials(suite, seeds), unit="motion", smoothing=0.05, mininterval=0.5
        ) as bar:
            for trial in expand(suite, seeds):
                yield trial
                bar.update()

    with (out / UPDATES).open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for rows in run_online(trials(), rules, memory=memory, hidden=out):
            writer.writerows(rows)
            file.flush()


def _write_tables(rows: pd.DataFrame, out: Path) -> None:
    summary = summary_table(rows)
    for name, table in ((SUMMARY, summary), (OVER_TIME, over_time_table(rows))):
        with whole_file(out / name) as path:
            table.to_csv(path, index=False)
    _say(rows, summary)
    click.echo(f"{out}: {UPDATES} has a row for each sample, {OVER_TIME} medians over time")


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

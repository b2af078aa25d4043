"""``olne-bench draws``: solve the draws of a suite once, for all machines that run it."""

import multiprocessing
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click
from tqdm import tqdm

from olne_bench.bench.judge.truth import Draw, held_out_recordings, true_recordings
from olne_bench.bench.plan.draws import about, draws_path
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.run.describe_plugins import describe_all
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.solved import DRAWS_SUFFIX, kept_draws
from olne_bench.envs.solved.draws_file import Draws, read_draws, write_draws
from olne_bench.errors import UserError
from olne_bench.plugins import SCENARIO, is_built_in

#: Draws after which the file is written, so that an interrupted command can go on.
_WRITE_EVERY = 20


@dataclass(frozen=True)
class SolvedDraw:
    """One draw."""

    scenario: str
    seed: int
    draws: Draws  # its motions, and what was refused on the way to them
    refused: str = ""  # why it has no truth, or no held-out starts; empty if it has both


def solve_draw(entry: ScenarioEntry, seed: int, salt: str, known: Draws) -> SolvedDraw:
    """Solve the truth of a draw, its further trajectories and its held-out starts."""
    draw, found, refused = Draw.of(entry, seed, salt), Draws(), ""
    with kept_draws.travelling(known), kept_draws.collecting(found):
        for motions in (true_recordings, held_out_recordings):
            try:
                recordings = motions(draw)
            except NoEquilibriumError as error:
                refused = refused or str(error)
                continue
            for one in recordings:
                found.add(one.scenario.game, one.scenario.weights, one)
    return SolvedDraw(entry.label, seed, found, refused)


def draws(
    suite: str, out: Path | None, jobs: int, scenario: tuple[str, ...], seeds: int | None
) -> None:
    """Solve all draws of SUITE and write them to a file, which 'olne-bench run' then uses."""
    whole = load_suite(suite, describe=partial(describe_all, hidden=out))
    if whole.kind == "drives":
        raise UserError(f"suite {whole.name!r} is a study of drives, which are drawn as they go on")
    path = out or draws_path(suite)
    if path.suffix != DRAWS_SUFFIX or not path.parent.is_dir():
        raise UserError(
            f"--out {path}: a file in an existing folder, which ends with {DRAWS_SUFFIX}"
        )
    known = _known(path, whole)
    todo = _todo(whole, scenario, seeds)
    refused: Counter[str] = Counter()
    for number, solved in enumerate(_solved(todo, whole.salt, known, jobs), start=1):
        known.update(solved.draws)
        if solved.refused:
            refused[solved.scenario] += 1
            tqdm.write(f"{solved.scenario}, seed {solved.seed}: {solved.refused}")
        if number % _WRITE_EVERY == 0:
            write_draws(path, known)
    write_draws(path, known)
    for label, number in Counter(entry.label for entry, _ in todo).items():
        click.echo(f"{label}: {number - refused[label]} of {number} draws")
    size = path.stat().st_size / 1e6
    click.echo(f"{path}: {len(known.motions)} motions, {size:.2f} MB; commit it with the suite")


def _known(path: Path, suite: Suite) -> Draws:
    """The draws that the file holds already. UserError if they are of another suite or salt."""
    if not path.exists():
        return Draws(place=str(path), about=about(suite))
    known = read_draws(path)
    if known.about != about(suite):
        raise UserError(f"{path} holds draws of another suite or salt; use another --out")
    return Draws(str(path), known.about, dict(known.motions), set(known.refused))


def _todo(
    suite: Suite, labels: tuple[str, ...], seeds: int | None
) -> list[tuple[ScenarioEntry, int]]:
    """Scenarios and seeds whose draws are to be solved."""
    entries = [suite.scenario(label) for label in labels] if labels else suite.scenarios
    todo: list[tuple[ScenarioEntry, int]] = []
    for entry in entries:
        if not is_built_in(SCENARIO, entry.name):
            click.echo(f"{entry.label} is a plugin: each run solves its draws", err=True)
            continue
        most = max(suite.seeds_of(entry, e) for s, e in suite.pairs() if s == entry)
        todo += [(entry, seed) for seed in range(min(most, seeds or most))]
    return todo


def _solved(
    todo: list[tuple[ScenarioEntry, int]], salt: str, known: Draws, jobs: int
) -> Iterator[SolvedDraw]:
    with tqdm(total=len(todo), unit="draw") as bar:
        if jobs == 1:
            for entry, seed in todo:
                yield solve_draw(entry, seed, salt, known)
                bar.update()
            return
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, mp_context=context) as pool:
            start = Draws(known.place, known.about, dict(known.motions), set(known.refused))
            futures = [pool.submit(solve_draw, *one, salt, start) for one in todo]
            for future in as_completed(futures):
                yield future.result()
                bar.update()

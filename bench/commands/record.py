"""``olne-bench record``: play a scenario's draws and write what happened."""

from pathlib import Path
from typing import Any

import click
import numpy as np
from tqdm import tqdm

from olne_bench import plugins
from olne_bench.bench.commands.options import name_and_value
from olne_bench.envs.recordings.recording import NoEquilibriumError, Recording, film
from olne_bench.envs.recordings.recording import record as play
from olne_bench.envs.recordings.recording_file import of_recordings, write_recording
from olne_bench.envs.scenarios import Scenario, get_scenario, is_family, scenario_options
from olne_bench.envs.worlds.video import SUFFIXES, check_format, write_video
from olne_bench.errors import UserError
from olne_bench.files import check_new_file

#: Videos run in real time, but not slower than this [frames/s].
SLOWEST_FPS = 2.5


def record(
    scenario: str, seeds: int, out: Path, video: Path | None, options: tuple[str, ...]
) -> None:
    """Play SCENARIO at its equilibrium and write the recording."""
    check_new_file("--out", out, (".parquet",))
    if video is not None:
        check_new_file("--video", video, SUFFIXES)
        check_format(video)
    chosen = dict(name_and_value("--option", text) for text in options)
    with plugins.loading(scenario):
        _record(scenario, seeds, chosen, out, video)


def _record(
    scenario: str, seeds: int, chosen: dict[str, Any], out: Path, video: Path | None
) -> None:
    """Play draws, write those that have an equilibrium, and say what became of each."""
    numbers = range(seeds if _is_family(scenario, chosen) else 1)
    if len(numbers) < seeds:
        click.echo(f"{scenario} is the same for every seed: one episode is recorded", err=True)

    played: dict[int, Recording] = {}
    refused: dict[int, str] = {}
    for seed in tqdm(numbers, unit="episode"):
        try:
            played[seed] = play(_draw(scenario, seed, chosen))
        except NoEquilibriumError as error:
            refused[seed] = str(error)
    for seed, reason in refused.items():
        click.echo(f"seed {seed} is not recorded: {reason}")
    if not played:
        raise UserError(f"no draw of {scenario!r} has a certified equilibrium; nothing is written")
    write_recording(out, of_recordings(list(played.values()), list(played), chosen))
    click.echo(f"{out}: {len(played)} of {len(numbers)} episodes of {scenario}")
    click.echo(_certified(list(played.values())))
    if video is not None:
        first = next(iter(played))
        drawn = played[first].scenario
        write_video(video, film(drawn), max(1 / drawn.game.dt, SLOWEST_FPS))
        click.echo(f"{video}: the episode of seed {first}")


def _certified(recordings: list[Recording]) -> str:
    """One line: what each search found in all episodes, and from how many first plans."""
    certificates = [recording.certificate for recording in recordings]
    searches = {
        "local": [(one.costs, one.local) for one in certificates],
        "global so far": [
            (one.costs, one.global_so_far) for one in certificates if one.global_so_far
        ],
    }
    told = []
    for name, found in searches.items():
        starts = sum(int(gains.starts.sum()) for _, gains in found)
        largest = max(float((gains.values / (1 + np.abs(costs))).max()) for costs, gains in found)
        told.append(f"{name}, largest gain {largest:.1e} from {starts} first plans")
    return f"certified: {'; '.join(told)}; gains are relative to 1 + |cost|"


def _draw(name: str, seed: int, options: dict[str, Any]) -> Scenario:
    try:
        return get_scenario(name, seed, **options)
    except (TypeError, ValueError) as error:
        raise UserError(f"--option: {error}") from error


def _is_family(name: str, options: dict[str, Any]) -> bool:
    place = ""
    try:
        scenario_options(name)  # refuses a name that nobody knows
        place = "--option: "
        return is_family(name, **options)
    except (TypeError, ValueError) as error:
        raise UserError(f"{place}{error}") from error

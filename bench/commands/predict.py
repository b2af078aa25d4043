"""``olne-bench predict``: what recorded cars do next."""

from pathlib import Path

import click
import numpy as np
import pandas as pd

from olne_bench.bench.report.escapes import write_csv
from olne_bench.bench.text import one_line
from olne_bench.envs.tracks.prediction import STEP, Foreseen, predict_cars, prediction_table
from olne_bench.envs.tracks.reading import on_lanes
from olne_bench.envs.worlds.video import SUFFIXES, check_format, write_video
from olne_bench.files import check_new_file


def predict(
    tracks: Path,
    format_name: str,
    road: Path | None,
    part: str | None,
    at: float | None,
    ahead: float,
    players: tuple[str, ...],
    out: Path | None,
    picture: Path | None,
    film: Path | None,
) -> None:
    """Predict the cars in TRACKS from a time on."""
    if out is not None:
        check_new_file("--out", out, (".csv",))
    if picture is not None:
        check_new_file("--picture", picture, (".png", ".svg", ".pdf"))
    if film is not None:
        check_new_file("--film", film, SUFFIXES)
        check_format(film)
    grid, lanes = on_lanes(tracks, format_name, road, part)
    time = float(grid.times[-1]) if at is None else at
    found = predict_cars(grid, lanes, time, ahead, players=players)
    _say(found, time, ahead)
    if out is not None:
        write_csv(prediction_table(found), out, new=True)
    if picture is not None or film is not None:
        from olne_bench.bench.report.figures import people, style

        with style.applied():
            if picture is not None:
                people.draw(found, grid, lanes, time).savefig(picture)
            if film is not None:
                write_video(film, people.film(found, grid, lanes, time), fps=1 / STEP)


def _say(found: list[Foreseen], at: float, ahead: float) -> None:
    """Where everybody is at the end, and how far off that was where it is recorded."""
    rows = []
    for one in found:
        x, y = one.game[-1]
        row = {"player": one.player, "leader": (*one.leaders, "")[0], "x": f"{x:.1f}"}
        row |= {"y": f"{y:.1f}", "along ±": f"{one.half_widths[-1, 0]:.1f}"}
        row |= {"across ±": f"{one.half_widths[-1, 1]:.1f}"}
        if np.isfinite(one.recorded[-1]).all():
            row |= {"error": _off(one, one.game), "straight on": _off(one, one.straight)}
        rows.append(row | {"note": one.why})
    click.echo(f"{ahead:g} s after {at:g} s, positions and 90 % regions along and across [m]:")
    table = pd.DataFrame(rows).fillna("").map(lambda value: one_line(str(value)))
    click.echo(table.to_string(index=False, justify="left"))
    known = [one for one in found if np.isfinite(one.recorded[-1]).all() and not one.why]
    if known:
        errors = [
            np.mean([abs(one.errors(getattr(one, name))[-1, 0]) for one in known])
            for name in ("game", "straight")
        ]
        click.echo(
            f"mean error along the lane of the {len(known)} with a leader: {errors[0]:.2g} m; "
            f"driving straight on {errors[1]:.2g} m"
        )


def _off(one: Foreseen, positions: np.ndarray) -> str:
    along, left = one.errors(positions)[-1]
    return f"{np.hypot(along, left):.1f}"

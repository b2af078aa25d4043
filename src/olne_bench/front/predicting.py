"""Predict recorded cars."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from olne_bench.envs.tracks.prediction import predict_cars, prediction_table
from olne_bench.envs.tracks.reading import on_lanes


def predict(
    tracks: str | Path,
    *,
    at: float | None = None,
    ahead: float = 3.0,
    players: Sequence[str] = (),
    format: str = "csv",  # noqa: A002
    road: str | Path | None = None,
) -> pd.DataFrame:
    """Predict where recorded cars will be, as ``olne-bench predict`` does.

    Args:
        tracks: a file of tracks, or a recording.
        at: the last time that is seen [s]. Default: the last one of the file.
        ahead: how far to look ahead [s].
        players: whom to predict. Default: all who are seen then.
        format: kind of the file, such as ``"commonroad"``.
        road: file of its lanes, where ``tracks`` has none.

    Returns:
        A row for each car and time: positions [m] by the game, straight on along the lane and as
        recorded, errors along the way and to its left, and halves of the 90 % regions.

    Raises:
        UserError: on a file that cannot be read or has no lanes, and where nobody is seen.
    """
    grid, lanes = on_lanes(Path(tracks), format, None if road is None else Path(road))
    time = float(grid.times[-1]) if at is None else at
    return prediction_table(predict_cars(grid, lanes, time, ahead, players=players))

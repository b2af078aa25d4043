"""Small recordings of cars that follow each other."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

LANE = "[lanes.lane]\npoints = [[-500, 0], [1500, 0]]\n"


def motion(seed: int, cars: int = 3, seconds: float = 8.0) -> np.ndarray:
    """(T, N) metres along a lane at steps of 0.2 s: each takes on its leader's speed in 1.5 s."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(seconds / 0.2) + 1) * 0.2
    first = 12 + 3 * np.sin(rng.uniform(0, 6) + times / 2)
    speeds = [first]
    for _ in range(1, cars):
        own = [first[0] + rng.uniform(-3, 3)]
        for ahead in speeds[-1][:-1]:
            own.append(own[-1] + 0.2 * (ahead - own[-1]) / 1.5)
        speeds.append(np.array(own))
    return np.stack([0.2 * np.cumsum(v) - 25 * k for k, v in enumerate(speeds)], axis=1)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Eight recordings of a lane."""
    folder = tmp_path / "data"
    folder.mkdir()
    for seed in range(8):
        along = motion(seed)
        parts = [
            pd.DataFrame(
                {"time": 0.2 * np.arange(len(along)), "player": f"car {k}", "x": x, "y": 0.0}
            )
            for k, x in enumerate(along.T)
        ]
        path = folder / f"A_Lane-{seed}_1.csv"
        pd.concat(parts).to_csv(path, index=False)
        path.with_suffix(".toml").write_text(LANE)
    return folder

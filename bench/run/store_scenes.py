"""Truths and motions beside the rows of a store, for the figures and the page of a report."""

import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from olne_bench.bench.judge.scene import NoSceneError, TrueScene, unpack_motion, unpack_truth
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.trial import Trial
from olne_bench.bench.plan.versions import VERSION_COLUMNS
from olne_bench.bench.run.store_check import checksum, said
from olne_bench.bench.run.store_file import glancing
from olne_bench.bench.run.store_layout import CURRENT, FILE_NAME, quoted

#: Seed of the only truth of a scenario that is no family.
_ANY_SEED = -1
#: What a truth depends on: the versions of all but the estimator.
_TRUTH_CODE = tuple(name for name in VERSION_COLUMNS if name != "estimator_version")
_TRUTH = (
    "SELECT s.content FROM scenes s JOIN current c USING (scenario, sensor) "
    f"WHERE s.scenario = ? AND s.seed IN (?, {_ANY_SEED}) AND s.salt_id = ? "
    "AND s.sensor = coalesce(?, s.sensor) "
    f"AND s.code = checksum({quoted(_TRUTH_CODE, 'c.')}) LIMIT 1"
)
_MOTION = (
    "SELECT m.states FROM motions m JOIN current c USING (scenario, sensor, estimator) "
    "WHERE m.scenario = ? AND m.seed = ? AND m.salt_id = ? AND m.sensor = ? AND m.sigma = ? "
    f"AND m.estimator = ? AND m.code = checksum({quoted(CURRENT, 'c.')})"
)


def add_scenes(connection: sqlite3.Connection, trial: Trial, outcome: Outcome) -> None:
    """Store what an outcome has of a truth and a motion, in place of what was there."""
    if outcome.scene is None and outcome.motion is None:
        return
    labels, versions = trial.labels, vars(trial.versions)
    scenario, seed, salt_id, sensor, sigma, estimator = (
        labels[name] for name in ("scenario", "seed", "salt_id", "sensor", "sigma", "estimator")
    )
    if outcome.scene is not None:
        code = checksum(*(v for name, v in versions.items() if name != "estimator"))
        of_draw = seed if trial.scenario.family else _ANY_SEED
        connection.execute(
            "INSERT OR REPLACE INTO scenes VALUES (?, ?, ?, ?, ?, ?)",
            (scenario, of_draw, salt_id, sensor, code, outcome.scene),
        )
    if outcome.motion is not None:
        code = checksum(*trial.code)
        connection.execute(
            "INSERT OR REPLACE INTO motions VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (scenario, seed, salt_id, sensor, sigma, estimator, code, outcome.motion),
        )


@dataclass(frozen=True)
class StoredScenes:
    """Truths and motions of the current rows of a run folder; each is read when it is asked for."""

    folder: Path
    salt_id: str  # of the salt of its draws

    def truth(self, scenario: str, seed: int, sensor: str | None = None) -> TrueScene:
        content = _read(self.folder, _TRUTH, (scenario, int(seed), self.salt_id, sensor))
        if content is None:
            raise NoSceneError("its truth is not stored")
        return _unpacked(content)

    def motion(self, trial: Mapping[Any, Any], shape: tuple[int, ...]) -> np.ndarray | None:
        place = (trial["scenario"], int(trial["seed"]), self.salt_id, trial["sensor"])
        key = (*place, float(trial["sigma"]), trial["estimator"])
        content = _read(self.folder, _MOTION, key)
        return None if content is None else unpack_motion(content, shape)


_unpacked = lru_cache(maxsize=64)(unpack_truth)


def _read(folder: Path, query: str, key: tuple[Any, ...]) -> bytes | None:
    try:
        with glancing(folder) as connection:
            row = connection.execute(query, key).fetchone()
    except sqlite3.Error as error:
        raise NoSceneError(f"{folder / FILE_NAME} cannot be read: {said(error)}") from error
    return row[0] if row else None

"""A study with scenarios and sensors by label, and trials on a road."""

import gzip
import json
import re
from base64 import b64decode
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.formulas import position_error
from olne_bench.bench.judge.scene import TrueScene
from olne_bench.bench.judge.truth import Draw, predict_from_start, true_recording
from olne_bench.bench.plan.entries import EstimatorEntry, PluginEntry, ScenarioEntry, SensorEntry
from olne_bench.bench.report.study import Study
from olne_bench.bench.submission.played import PlayedScenes
from olne_bench.envs import highway_v0
from olne_bench.envs.roads.temperaments import checked_shares
from olne_bench.envs.scenarios import check_options
from olne_bench.plugins import ESTIMATOR, names


def trial_row(**changes: Any) -> dict[str, Any]:
    """A trial that went well, as tables have it, and what is different of it."""
    row = {"suite": "s", "scenario": "s", "sensor": "full", "estimator": "e", "sigma": 0.05}
    row |= {"seed": 0, "parameters": "{}", "count": 1, "status": "ok", "message": ""}
    row |= {"cosine_error": 0.1, "cosine_limit": 0.05, "position_error": 1.0}
    row |= {"observation_error": 0.04, "published_forward": 1.0, "solve_seconds": 0.1}
    return row | {"weights": None} | changes


#: What a trial that failed lacks.
LOST = dict.fromkeys(("cosine_error", "position_error", "published_forward"), np.nan)


class ScenesHere(PlayedScenes):
    """Truths and motions of trials that no store holds."""

    def motion(self, trial: Mapping[Any, Any], shape: tuple[int, ...]) -> np.ndarray | None:
        if trial["weights"] is None:
            return None
        draw = Draw.of(self.study.scenario(trial["scenario"]), trial["seed"], self.study.salt)
        weights = np.array([list(row) for row in trial["weights"]])
        root = predict_from_start(draw, weights, 300).root
        return None if root is None else root.states


@pytest.fixture(scope="session")
def usual() -> Study:
    scenarios = [
        ScenarioEntry(name="two_player", label="two_player"),
        ScenarioEntry(name="two_player", label="two_player(trajectories=4)", trajectories=4),
        ScenarioEntry(name="highway_overtaking", label="highway_overtaking"),
        ScenarioEntry(name="random", label="random", family=True),
        ScenarioEntry(name="unknown_goals", label="unknown_goals", family=True),
    ]
    sensors = [SensorEntry(label=n, layers=(PluginEntry(name=n),)) for n in ("full", "partial")]
    study = Study(
        scenarios={entry.label: entry for entry in scenarios},
        sensors={entry.label: entry for entry in sensors},
        salt="test",
        estimators={n: EstimatorEntry(name=n, label=n) for n in ("kkt_constrained", "uniform")},
    )
    return replace(study, scenes=ScenesHere(study))


@pytest.fixture(scope="session")
def embedded() -> Callable[[str], Any]:
    """What the script of a page reads from its HTML."""

    def read(html: str) -> Any:
        found = re.search(r'<script type="text/plain" id="data">(.*?)</script>', html, re.DOTALL)
        assert found is not None
        return json.loads(gzip.decompress(b64decode(found[1])))

    return read


@pytest.fixture(scope="session")
def prediction_error(usual: Study) -> Callable[[str, int, np.ndarray], float]:
    """The position error of the forward game at weights, from a draw's own start."""

    def error(scenario: str, seed: int, weights: np.ndarray) -> float:
        truth = usual.scenes.truth(scenario, seed).states
        row = {"scenario": scenario, "seed": seed, "weights": weights}
        motion = usual.scenes.motion(row, truth.shape)
        assert motion is not None
        return position_error(truth, motion)

    return error


class Tempered:
    """Drivers of a family's draws, without motions: no game is solved."""

    def __init__(self, entry: ScenarioEntry, salt: str) -> None:
        self._entry, self._salt = entry, salt
        self._family: Any = check_options(entry.name, **entry.options)

    def truth(self, scenario: str, seed: int, sensor: str | None = None) -> TrueScene:
        own, nothing = Draw.of(self._entry, seed, self._salt).seed, np.zeros((0, 0))
        return TrueScene(
            **{"road": "", "dt": 1.0, "state_names": (), "weight_names": (), "noise_scale": ()},
            **{"states": nothing, "parameters": nothing, "information_root": nothing},
            unknowns=(),
            weights=self._family.tempered(own),
            temperaments=self._family.temperaments(own),
            shares=checked_shares(self._family.shares),
        )

    def motion(self, trial: Mapping[Any, Any], shape: tuple[int, ...]) -> None:
        return None


@pytest.fixture(scope="session")
def tempered() -> Callable[..., Study]:
    """Makes a study of drivers at an intersection who have temperaments."""

    def make(num_players: Any) -> Study:
        options = {"weights": "temperaments", "num_players": num_players}
        road = ScenarioEntry(name="intersection", label="road", options=options, family=True)
        two = ScenarioEntry(name="two_player", label="two")
        known = {"road": road, "two": two}
        return Study(scenarios=known, salt="s", scenes=Tempered(road, "s"))

    return make


ROAD = ScenarioEntry(name="roundabout", label="roundabout", options={"num_players": 2}, family=True)


@pytest.fixture(scope="session")
def road_study() -> Study:
    sensors = [SensorEntry(label=n, layers=(PluginEntry(name=n),)) for n in ("full", "partial")]
    known = {s.label: s for s in sensors}
    study = Study(scenarios={"roundabout": ROAD}, sensors=known, salt="test")
    return replace(study, scenes=ScenesHere(study))


@pytest.fixture(scope="session")
def road_trials(road_study: Study) -> pd.DataFrame:
    """Trials of one draw on a road, for which each built-in estimator finds the true weights."""
    weights = road_study.scenes.truth("roundabout", 0).weights.tolist()
    errors = ("cosine_error", "position_error", "reconstruction_error", "held_out_error")
    told = dict.fromkeys(errors, 0.0) | {"covers_truth": 1, "cosine_limit": 0.01}
    place = {"suite": "roads", "scenario": "roundabout", "sigma": 0.1, "weights": weights}
    return pd.DataFrame(
        [
            trial_row(**place, **told, estimator=estimator, sensor=sensor)
            for estimator in names(ESTIMATOR)
            for sensor in ("full", "partial")
        ]
    )


@pytest.fixture(scope="session")
def road_frame(road_study: Study) -> tuple[np.ndarray, np.ndarray]:
    """HighwayEnv's picture of that draw at its start, and the cars' places (N, 2) [pixels]."""
    world = highway_v0.parallel_env(
        true_recording(Draw.of(ROAD, 0, road_study.salt)).scenario, render_mode="rgb_array"
    )
    world.reset()
    frame = world.render()
    colours = [v.color for v in world._roads["roundabout"].controlled_vehicles]
    found = [np.argwhere((frame == colour).all(axis=-1)).mean(axis=0)[::-1] for colour in colours]
    return frame, np.array(found)

"""Truths and motions are stored beside rows, merged, replaced, and checked when they are read."""

import sqlite3
from contextlib import closing
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from olne_bench.bench.judge.scene import (
    NoSceneError,
    Quantity,
    TrueScene,
    pack_motion,
    pack_truth,
    unpack_truth,
)
from olne_bench.bench.plan.entries import ScenarioEntry
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.outcome import Outcome
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.suite import salt_id
from olne_bench.bench.plan.trial import Trial, expand
from olne_bench.bench.plan.versions import Versions
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.store import open_store
from olne_bench.bench.run.store_layout import FILE_NAME
from olne_bench.bench.run.store_scenes import StoredScenes

SOURCE = Provenance("", "{}", "", Selection(), 1, "", {}, {}, "", {})
SCENE = TrueScene(
    road="",
    dt=0.25,
    state_names=("px", "py"),
    weight_names=("near", "fast", "turn"),
    noise_scale=(1.0, 2.0),
    states=np.arange(12.0).reshape(3, 2, 2),
    weights=np.full((2, 3), 1 / 3),
    parameters=np.array([[0.5], [np.nan]]),
    unknowns=((Quantity("radius", "m", 0.25),), ()),
    information_root=np.triu(np.ones((5, 5))),
)
MOTION = SCENE.states + 0.125


def a_trial(scenario: str = "two_player", seed: int = 0) -> Trial:
    part = Selection(scenarios=("two_player",), estimators=("uniform",))
    trial = next(expand(select(load_suite("quick"), part)))
    entry = ScenarioEntry(name=scenario, label=scenario, family=scenario == "random")
    return replace(trial, scenario=entry, seed=seed)


def outcome(scene: TrueScene = SCENE, motion: np.ndarray = MOTION) -> Outcome:
    return Outcome("ok", scene=pack_truth(scene), motion=pack_motion(motion))


def stored(folder, *pairs) -> StoredScenes:
    with open_store(folder) as store:
        for trial, ended in pairs:
            store.begin_run(SOURCE, [trial])
            store.add(trial, ended)
    return StoredScenes(folder, salt_id(pairs[0][0].salt))


def motion_of(scenes: StoredScenes, trial) -> np.ndarray | None:
    return scenes.motion(trial.labels, MOTION.shape)


def change(folder, statement: str) -> None:
    with closing(sqlite3.connect(folder / FILE_NAME)) as connection, connection:
        assert connection.execute(statement).rowcount


def test_both_come_back_for_their_row_only(tmp_path):
    trial, family = a_trial(), a_trial("random", seed=3)
    other = msgspec.structs.replace(SCENE, weights=SCENE.weights[::-1] * np.array([[1], [2]]))
    scenes = stored(tmp_path, (trial, outcome()), (family, outcome(other)))
    back = scenes.truth("two_player", 7)  # no family: one truth for all seeds
    for name in SCENE.__struct_fields__:
        told, expected = getattr(back, name), getattr(SCENE, name)
        array = isinstance(expected, np.ndarray)
        assert np.array_equal(told, expected, equal_nan=True) if array else told == expected
    np.testing.assert_array_equal(back.used, [[True], [False]])
    np.testing.assert_array_equal(back.deviations, [[0.25], [np.nan]])
    np.testing.assert_array_equal(motion_of(scenes, trial), MOTION)
    assert scenes.truth("random", 3, "full").weights[1, 0] == pytest.approx(2 / 3)
    assert motion_of(scenes, replace(trial, seed=1)) is None
    for place in (("random", 4), ("gone", 0), ("two_player", 0, "gone")):
        with pytest.raises(NoSceneError, match="its truth is not stored"):
            scenes.truth(*place)
    with pytest.raises(NoSceneError, match="not stored"):
        StoredScenes(tmp_path, "other").truth("two_player", 0)


def test_what_is_run_again_replaces_them_and_other_code_has_its_own(tmp_path):
    trial = a_trial()
    later = replace(trial, versions=Versions("a", "b", "c", "d", "e"))
    again = outcome(msgspec.structs.replace(SCENE, dt=0.5), MOTION + 1)
    scenes = stored(tmp_path, (trial, outcome()), (trial, again))
    assert scenes.truth("two_player", 0).dt == 0.5
    np.testing.assert_array_equal(motion_of(scenes, trial), MOTION + 1)
    stored(tmp_path, (later, outcome()))
    assert scenes.truth("two_player", 0).dt == 0.25
    with open_store(tmp_path) as store:  # back to the former code
        store.begin_run(SOURCE, [trial])
    assert scenes.truth("two_player", 0).dt == 0.5
    np.testing.assert_array_equal(motion_of(scenes, trial), MOTION + 1)


def test_stores_are_merged_with_them(tmp_path):
    one, other = a_trial(), a_trial("random")
    scenes = stored(tmp_path / "a", (one, outcome()))
    stored(tmp_path / "b", (other, outcome(motion=MOTION + 1)))
    with open_store(tmp_path / "a") as store:
        store.merge(tmp_path / "b" / FILE_NAME)
    assert scenes.truth("two_player", 0).dt == scenes.truth("random", 0).dt == 0.25
    np.testing.assert_array_equal(motion_of(scenes, other), MOTION + 1)


@pytest.mark.parametrize("table", ["scenes", "motions"])
@pytest.mark.parametrize("damage", ["zeroblob(40)", "substr({0}, 1, 20)", "'text'", "x'789c'"])
def test_damage_is_one_line_when_it_is_read_and_the_store_still_opens(tmp_path, table, damage):
    trial = a_trial()
    scenes = stored(tmp_path, (trial, outcome()))
    column = {"scenes": "content", "motions": "states"}[table]
    change(tmp_path, f"UPDATE {table} SET {column} = {damage.format(column)}")
    with open_store(tmp_path) as store:
        assert len(store.frame()) == 1
    with pytest.raises(NoSceneError, match="damaged") as error:
        scenes.truth("two_player", 0) if table == "scenes" else motion_of(scenes, trial)
    assert str(error.value).isprintable()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("states", np.zeros((3, 1, 2))),
        ("weights", np.ones((2, 4))),
        ("parameters", np.ones((2, 2))),
        ("information_root", np.eye(4)),
        ("state_names", ("px",)),
        ("temperaments", ("normal",)),
    ],
)
def test_what_does_not_fit_is_refused(name, value):
    with pytest.raises(NoSceneError, match=f"{name} of another shape"):
        unpack_truth(pack_truth(msgspec.structs.replace(SCENE, **{name: value})))


def test_a_motion_of_another_shape_and_too_large_a_truth_are_refused(tmp_path):
    trial = a_trial()
    scenes = stored(tmp_path, (trial, outcome(motion=MOTION[:2])))
    with pytest.raises(NoSceneError, match="damaged"):
        motion_of(scenes, trial)
    bomb = msgspec.structs.replace(SCENE, states=np.zeros((2**21, 2, 2)))
    with pytest.raises(NoSceneError, match="too large"):
        unpack_truth(pack_truth(bomb))

import itertools
from pathlib import Path

import numpy as np
import pytest

from olne_bench.bench.plan.entries import EstimatorEntry, ScenarioEntry
from olne_bench.bench.plan.load import load_suite, suite_names
from olne_bench.bench.plan.truths import drawn_twin, has_drawn_truths, is_foreign
from olne_bench.envs.recordings.recording import NoEquilibriumError
from olne_bench.envs.scenarios import get_scenario

FIXED = {"paper", "sensors", "several"}


@pytest.mark.parametrize("name", suite_names())
def test_truths_of_every_suite(name: str) -> None:
    suite = load_suite(name)
    if suite.kind == "drives":
        return  # their roads draw cars as they go on
    drawn = [has_drawn_truths(scenario) for scenario in suite.scenarios]
    if name in FIXED:
        assert not any(drawn)
    elif name == "field":  # both scenarios of the paper, and the roads
        assert drawn == [False] * 2 + [True] * 5
    elif name == "parameters":  # goals are drawn there, weights are not
        assert drawn == [False, True, True]
    else:
        assert all(drawn)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("two_player", {}),
        ("two_player", {"weights": "dirichlet"}),
        ("highway_overtaking", {"weights": "dirichlet"}),
        ("unknown_goals", {}),
        ("merging", {}),
        ("merging", {"weights": "moderate"}),
        ("random", {"num_players": 2}),
    ],
)
def test_truths_are_drawn_if_seeds_have_other_weights(name: str, options: dict) -> None:
    family = name != "two_player" or bool(options)
    entry = ScenarioEntry(name=name, label=name, options=options, family=family)
    found: list[np.ndarray] = []
    for seed in itertools.count():
        try:
            found.append(get_scenario(name, seed, **options).weights)
        except NoEquilibriumError:
            continue
        if len(found) == 2:
            break
    assert has_drawn_truths(entry) == (not np.array_equal(*found))


def test_options_of_another_version_draw_nothing() -> None:
    entry = ScenarioEntry(name="merging", options={"weights": "unheard of"}, family=True)
    assert not has_drawn_truths(entry)


def test_a_plugin_is_taken_at_its_word() -> None:
    assert has_drawn_truths(ScenarioEntry(name="/gone/mine.py", family=True))
    assert not has_drawn_truths(ScenarioEntry(name="/gone/mine.py"))


def test_foreign_estimators(tmp_path: Path) -> None:
    assert is_foreign(EstimatorEntry(name=str(tmp_path / "map.py"), label="map"))
    assert not is_foreign(EstimatorEntry(name="map", label="mine"))


@pytest.mark.parametrize("name", ["two_player", "highway_overtaking", "merging"])
def test_a_fixed_scenario_has_a_twin_whose_weights_are_drawn(name: str) -> None:
    fixed = ScenarioEntry(name=name, label="mine", trajectories=3, sigmas=(0.5,))
    twin = drawn_twin(fixed)
    assert twin is not None
    assert not has_drawn_truths(fixed)
    assert has_drawn_truths(twin)
    assert twin.label == "mine, drawn weights"
    assert (twin.name, twin.trajectories, twin.sigmas) == (name, 3, (0.5,))


@pytest.mark.parametrize("name", ["unknown_goals", "/gone/mine.py"])
def test_what_cannot_draw_weights_has_no_twin(name: str) -> None:
    assert drawn_twin(ScenarioEntry(name=name, label="mine", family=True)) is None

import re
from types import SimpleNamespace

import pytest

from olne_bench.bench.plan.load import (
    MOST_BYTES,
    MOST_TRIALS,
    check_gate,
    check_suite,
    load_suite,
    suite_names,
    suite_text,
)
from olne_bench.bench.plan.select import Selection, select
from olne_bench.bench.plan.suite import Suite, read_suite_json
from olne_bench.bench.plan.trial import expand, number_of_trials
from olne_bench.envs.roads.highway_roads import ROAD_NAMES
from olne_bench.errors import UserError
from olne_bench.games.solve.ipopt import PUBLISHED_ITERATIONS

GOOD = """
name = "tiny"
scenarios = ["two_player"]
sensors = ["full"]
sigmas = [0.0, 0.1]
seeds = 3
estimators = ["uniform"]
"""


def write(tmp_path, text):
    path = tmp_path / "suite.toml"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("name", suite_names())
def test_shipped_suites_are_valid(name):
    assert load_suite(name).name == name


def test_paper_suite_is_the_published_study():
    suite = load_suite("paper")
    assert len(suite.sigmas) == 22
    assert suite.seeds == 40
    trials = list(expand(suite))
    for scenario in ("two_player", "highway_overtaking"):
        for view in ("full", "partial"):
            for estimator in ("kkt_constrained", "kkt_residual", "uniform", "ukf"):
                place = (scenario, view, estimator)
                part = [t for t in trials if (t.cell[0], t.cell[1], t.cell[4]) == place]
                # The filter's forward games would take too long on five players.
                all_of_it = estimator != "ukf" or scenario == "two_player"
                assert sum(t.count for t in part) == (880 if all_of_it else 0)
                assert len(part) == (841 if all_of_it else 0)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("seeds = 3", "seeds = 3\nhorizon = 3", "unknown key 'horizon'; known are: name"),
        ("seeds = 3", "", "key 'seeds' is missing"),
        ("seeds = 3", "seeds = 0", "seeds: Input should be greater than 0, got 0"),
        ("0.1]", "-0.1]", "sigmas.1: Input should be greater than or equal to 0, got -0.1"),
        ("0.1]", "nan]", "sigmas.1"),
        ("0.1]", "0.0]", "sigma 0.0 is listed twice"),
        ("two_player", "three_player", "unknown scenario 'three_player'; known are: changed, fo"),
        ('"two_player"', '{name="random", options={players=3}}', "its parameters: num_players"),
        ('"two_player"', '{name="random", option={}}', "unknown key 'scenarios.0.option'"),
        ('"two_player"', '{name="merge", options={num_players=9}}', "'merge' holds 2 to 6 players"),
        ("seeds = 3", "seeds = 3\nroot_iterations = -1", "root_iterations: Input should be"),
        ('"full"', '"fulll"', "unknown sensor 'fulll'; known are: correlated, drop, full"),
        ('"uniform"', '"unifrom"', "unknown estimator 'unifrom'; known are: behaving, bilevel"),
        ('"uniform"', '{name="uniform", parameters={a=1}}', "refuses its parameters"),
        ('"uniform"', '"uniform", "uniform"', "estimator label 'uniform' is listed twice"),
        ('["full"]', "[]", "sensors"),
        ("seeds = 3", "seeds = true", "seeds: Input should be a valid integer, got True"),
        ("seeds = 3", "seeds = 3\ntime_limit = true", "time_limit: Input should be a valid number"),
        ("0.1]", "true]", "sigmas.1: Input should be a valid number, got True"),
        ('"two_player"', '{name="two_player", seeds=4}', "'two_player' has seeds = 4, the suite"),
        ('"uniform"', '{name="uniform", seeds=4}', "estimator 'uniform' has seeds = 4, the suite"),
        ("name =", "name", "not valid TOML"),
    ],
)
def test_a_malformed_suite_is_refused_in_one_line(tmp_path, old, new, expected):
    path = write(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(UserError) as caught:
        load_suite(path)
    assert expected in str(caught.value)
    assert path in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("gate", "expected"),
    [
        ("nobody = {failures = 0}", "[gate.nobody] is for an unknown estimator 'nobody'; the s"),
        ("uniform = {failures = 0, sensors = ['a']}", "[gate.uniform]: unknown sensor 'a'; the s"),
        ("uniform = {failures = 0, scenarios = ['x']}", "uniform]: unknown scenario 'x'; the sui"),
        ("uniform = {time_ratio = 2, time_reference = 'x'}", "unknown time_reference 'x'; the sui"),
    ],
)
def test_a_gate_on_what_is_not_run_is_refused(tmp_path, gate, expected):
    suite = load_suite(write(tmp_path, f"{GOOD}\n[gate]\n{gate}\n"))
    with pytest.raises(UserError) as caught:
        check_gate(suite)
    assert expected in str(caught.value)


@pytest.mark.parametrize("name", suite_names())
def test_gates_of_our_suites_are_about_them(name):
    check_gate(load_suite(name))


def test_selecting_keeps_the_trials_of_the_whole():
    suite = load_suite("paper")
    part = select(suite, Selection(scenarios=("two_player",), sensors=("full",), sigmas=(0.01,)))
    whole = {trial.key: trial for trial in expand(suite)}
    chosen = list(expand(part, seeds=5))
    assert len(chosen) == 4 * 5
    assert all(whole[trial.key] == trial for trial in chosen)


def test_a_family_has_a_trial_per_seed_even_without_noise(tmp_path):
    path = write(tmp_path, GOOD.replace('"two_player"', '"random"'))
    noise_free = [trial for trial in expand(load_suite(path)) if trial.sigma == 0]
    assert [trial.count for trial in noise_free] == [1, 1, 1]


@pytest.mark.parametrize("seeds", [None, 1, 2, 9])
def test_trials_are_as_many_as_they_are_said_to_be(tmp_path, seeds):
    scenarios = '["two_player", "random", {name = "merge", sigmas = [0.0, 1.0, 2.0], seeds = 2}]'
    estimators = '["uniform", {name = "kkt_residual", scenarios = ["random"], seeds = 1}]'
    text = GOOD.replace('["two_player"]', scenarios).replace('["uniform"]', estimators)
    suite = load_suite(write(tmp_path, text.replace('"full"', '"full", "partial"')))
    assert number_of_trials(suite, seeds) == len(list(expand(suite, seeds)))


def test_a_worker_is_done_with_a_game_before_the_next(tmp_path):
    text = GOOD.replace('"full"', '"full", "partial"').replace("two_player", "random")
    seeds = [trial.seed for trial in expand(load_suite(write(tmp_path, text)))]
    assert seeds == sorted(seeds)
    paper = expand(load_suite("paper"))
    seen = [t.sensor.label for t in paper if t.scenario.name == "two_player"]
    assert seen == sorted(seen)


def test_traffic_of_the_roads_suite_is_checked_without_being_solved(monkeypatch):
    monkeypatch.setattr("olne_bench.envs.roads.road_scenario.certified_equilibrium", None)
    suite = load_suite("roads")
    assert {entry.name for entry in suite.scenarios} == {*ROAD_NAMES, "merging"}
    assert (min(suite.sigmas), max(suite.sigmas)) == (0, 1)


def test_two_settings_of_one_estimator_need_labels(tmp_path):
    entries = '{name="uniform", label="a"}, {name="uniform", label="b"}'
    suite = load_suite(write(tmp_path, GOOD.replace('"uniform"', entries)))
    assert [entry.label for entry in suite.estimators] == ["a", "b"]


def test_trajectories_of_the_suite_are_those_of_scenarios_that_do_not_say(tmp_path):
    text = GOOD.replace('["two_player"]', '["two_player", {name = "random", trajectories = 1}]')
    suite = load_suite(write(tmp_path, text + "trajectories = 4\n"))
    assert [entry.label for entry in suite.scenarios] == ["two_player(trajectories=4)", "random"]
    assert [entry.trajectories for entry in suite.scenarios] == [4, 1]
    assert suite.trajectories == 4


def test_an_estimator_may_be_limited_to_scenarios_and_seeds(tmp_path):
    text = GOOD.replace('["two_player"]', '["two_player", "highway_overtaking"]')
    entry = '["uniform", {name = "kkt_residual", scenarios = ["two_player"], seeds = 2}]'
    trials = list(expand(load_suite(write(tmp_path, text.replace('["uniform"]', entry)))))
    limited = [trial for trial in trials if trial.estimator.name == "kkt_residual"]
    assert [(t.scenario.name, t.sigma, t.seed, t.count) for t in limited] == [
        ("two_player", 0.0, 0, 2),
        ("two_player", 0.1, 0, 1),
        ("two_player", 0.1, 1, 1),
    ]
    assert sum(trial.count for trial in trials if trial.estimator.name == "uniform") == 12


def test_a_scenario_may_have_noise_levels_and_seeds_of_its_own(tmp_path):
    road = '"two_player", {name = "highway_overtaking", sigmas = [0.0, 0.5], seeds = 2}'
    suite = load_suite(write(tmp_path, GOOD.replace('"two_player"', road)))
    trials = list(expand(suite))
    own = [t for t in trials if t.scenario.name == "highway_overtaking"]
    assert [(t.sigma, t.seed, t.count) for t in own] == [(0.0, 0, 2), (0.5, 0, 1), (0.5, 1, 1)]
    assert sum(t.count for t in trials if t.scenario.name == "two_player") == 6
    # What is selected is part of the whole; a scenario without the level is left out.
    part = list(expand(select(suite, Selection(sigmas=(0.5,)))))
    assert part == own[1:]
    assert {t.scenario.name for t in expand(select(suite, Selection(sigmas=(0.1,))))} == {
        "two_player"
    }
    assert len(list(expand(select(suite, Selection(sigmas=(0.0,))), seeds=1))) == 2
    with pytest.raises(UserError, match=re.escape("has no sigma 0.2; it has: 0.0, 0.1, 0.5")):
        select(suite, Selection(sigmas=(0.2,)))
    # A run stores its suite and reads it again.
    again = read_suite_json(suite.model_dump_json())
    assert [t.key for t in expand(again)] == [t.key for t in trials]


def test_an_estimator_may_see_more_draws_of_one_scenario(tmp_path):
    text = GOOD.replace('["two_player"]', '["two_player", "highway_overtaking"]').replace(
        '["uniform"]', '[{name = "uniform", seeds = 1, seeds_in = {highway_overtaking = 2}}]'
    )
    suite = load_suite(write(tmp_path, text))
    seeds = {scenario.name: suite.seeds_of(scenario, one) for scenario, one in suite.pairs()}
    assert seeds == {"two_player": 1, "highway_overtaking": 2}


def test_a_scenario_lists_no_noise_level_twice(tmp_path):
    text = GOOD.replace('["two_player"]', '[{name = "two_player", sigmas = [0.1, 0.1]}]')
    with pytest.raises(UserError, match=r"'two_player': sigma 0\.1 is listed twice"):
        load_suite(write(tmp_path, text))


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ('scenarios = ["highway"]', "limited to an unknown scenario 'highway'; the suite has: two"),
        ("seeds = 0", "estimators.0.seeds: Input should be greater than 0, got 0"),
        ("seeds_in = { highway = 2 }", "limited to an unknown scenario 'highway'; the suite has:"),
        ("seeds_in = { two_player = 9 }", "estimator 'uniform' has seeds = 9, the suite has only"),
    ],
)
def test_a_malformed_limit_is_refused(tmp_path, entry, message):
    text = GOOD.replace('["uniform"]', f'[{{name = "uniform", {entry}}}]')
    with pytest.raises(UserError, match=re.escape(message)):
        load_suite(write(tmp_path, text))


BARE = {
    "name": "bare",
    "scenarios": ["two_player"],
    "sensors": ["full"],
    "sigmas": [0.1],
    "seeds": 3,
    "estimators": ["uniform"],
}


@pytest.mark.parametrize(
    ("given", "salt"), [({}, "bare"), ({"salt": ""}, "bare"), ({"salt": "own"}, "own")]
)
def test_a_suite_is_salted_by_its_name_where_it_does_not_say(given, salt):
    assert Suite.model_validate(BARE | given).salt == salt


def test_what_a_suite_does_not_say_is_that_of_the_published_study():
    suite = Suite.model_validate(BARE)
    assert suite.root_iterations == PUBLISHED_ITERATIONS
    assert suite.time_limit > 0
    assert suite.trajectories == 1
    assert [entry.trajectories for entry in suite.scenarios] == [1]
    assert suite.metrics == () and suite.gate == {} and suite.description == ""


def test_what_is_looked_for_by_its_label_is_found_or_the_others_are_named():
    data = BARE | {
        "scenarios": [{"name": "a", "label": "x"}, {"name": "a", "label": "y"}],
        "sensors": [{"name": "b", "label": "u"}, {"name": "b", "label": "v"}],
    }
    suite = Suite.model_validate(data)
    assert [suite.scenario(label).label for label in "xy"] == ["x", "y"]
    assert [suite.sensor(label).label for label in "uv"] == ["u", "v"]
    with pytest.raises(UserError, match="suite 'bare' has no scenario 'z'; it has: x, y"):
        suite.scenario("z")
    with pytest.raises(UserError, match="suite 'bare' has no sensor 'x'; it has: u, v"):
        suite.sensor("x")


@pytest.mark.parametrize(
    ("of_scenario", "of_estimator", "seeds"),
    [(None, None, 3), (2, None, 2), (None, 1, 1), (2, 1, 1), (1, 2, 1)],
)
def test_the_fewest_seeds_that_anybody_asks_for_count(of_scenario, of_estimator, seeds):
    data = BARE | {
        "scenarios": [{"name": "a", "label": "a", "seeds": of_scenario, "sigmas": [0.2, 0.3]}],
        "estimators": [{"name": "e", "label": "e", "seeds": of_estimator, "scenarios": ["a"]}],
    }
    suite = Suite.model_validate(data)
    ((scenario, estimator),) = suite.pairs()
    assert suite.seeds_of(scenario, estimator) == seeds
    assert suite.sigmas_of(scenario) == (0.2, 0.3)
    assert suite.sigmas_of(scenario.model_copy(update={"sigmas": ()})) == (0.1,)


def test_a_stored_suite_that_is_damaged_is_told_in_one_short_line():
    text = Suite.model_validate(BARE).model_dump_json()
    assert read_suite_json(text) == Suite.model_validate(BARE)
    for damaged in (text.replace('"seeds":3', '"seeds":0', 1), text[:-5], "[]"):
        with pytest.raises(UserError, match="it is damaged, or of another version") as caught:
            read_suite_json(damaged)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 1000
    with pytest.raises(UserError, match=r"\(seeds: Input should be greater than 0, got 0\)"):
        read_suite_json(text.replace('"seeds":3', '"seeds":0', 1))
    with pytest.raises(UserError, match=r"\(sigmas\.0: .*, got -1"):
        read_suite_json(text.replace("[0.1]", "[-1.0]", 1))


@pytest.mark.parametrize("beyond", [0, 1])
def test_a_suite_file_has_a_size(tmp_path, beyond):
    text = GOOD + "#" * (MOST_BYTES - len(GOOD) + beyond)
    path = write(tmp_path, text)
    if not beyond:
        assert suite_text(path) == text
        return
    with pytest.raises(UserError, match=f"larger than {MOST_BYTES} bytes: that is not a suite"):
        suite_text(path)


def test_a_study_has_no_more_trials_than_can_be_run():
    entries = [{"name": "a", "label": f"a{k}", "family": True} for k in range(10)]
    suite = Suite.model_validate(BARE | {"scenarios": entries, "seeds": MOST_TRIALS // 10})
    check_suite(suite)
    more = suite.model_copy(update={"scenarios": suite.scenarios + suite.scenarios[:1]})
    with pytest.raises(UserError, match="scenario 'a0' is listed twice"):
        check_suite(more)
    label = {"label": "a"}
    other = suite.scenarios[0].model_copy(update=label)
    more = suite.model_copy(update={"scenarios": (*suite.scenarios, other)})
    with pytest.raises(UserError, match=f"it has {11 * MOST_TRIALS // 10} trials, at most"):
        check_suite(more)


@pytest.mark.parametrize(
    ("column", "taken"),
    [
        *((column, True) for column in ("a", "a" * 60, "a_1")),
        *((column, False) for column in ("a" * 61, "1a", "A", "a b", "seed", "status", "run")),
    ],
)
def test_a_metric_has_the_name_of_a_new_column(column, taken):
    suite = Suite.model_validate(BARE | {"metrics": [{"name": "m"}]})
    (metric,) = suite.metrics
    suite = suite.model_copy(update={"metrics": (SimpleNamespace(column=column),)})
    assert metric.name == "m"
    if taken:
        check_suite(suite)
        return
    with pytest.raises(UserError, match=f"a metric is called '{column}'"):
        check_suite(suite)


def test_as_many_seeds_as_the_suite_has_are_no_more():
    data = BARE | {"scenarios": [{"name": "a", "label": "a", "seeds": 3}]}
    data |= {"estimators": [{"name": "e", "label": "e", "seeds": 3}]}
    suite = Suite.model_validate(data)
    check_suite(suite)
    assert select(suite, Selection(seeds=3)) == suite
    with pytest.raises(UserError, match="--seeds 4: suite 'bare' has 3"):
        select(suite, Selection(seeds=4))


def test_a_selection_reads_like_a_command_line():
    assert str(Selection()) == ""
    chosen = Selection(
        scenarios=("a b",), sensors=("full",), sigmas=(0.1,), estimators=("e",), seeds=2
    )
    said = "--scenario 'a b' --sensor full --estimator e --sigma 0.1 --seeds 2"
    assert str(chosen) == said

"""Options of a run change a suite into another one."""

import json
from types import SimpleNamespace

import pytest

from olne_bench.bench.plan.kinds import REFERENCES
from olne_bench.bench.plan.learn import describe_here
from olne_bench.bench.plan.load import load_suite
from olne_bench.bench.plan.select import Selection, changed, joined, select
from olne_bench.bench.plan.suite import read_suite_json
from olne_bench.bench.plan.trial import expand
from olne_bench.bench.run.resume import check_same_suite
from olne_bench.errors import UserError


@pytest.fixture(scope="module")
def quick():
    return load_suite("quick")


def change(suite, **selection):
    return changed(suite, Selection(**selection), describe_here)


def test_a_part_is_no_change(quick):
    part = {"estimators": ("uniform",), "sigmas": (0.05,), "scenarios": ("two_player",), "seeds": 2}
    assert change(quick, **part) is quick


def test_what_is_new_replaces_its_kind_only(quick):
    other = change(quick, estimators=("ridge", "uniform"), sigmas=(0.3,))
    assert (other.name, other.origin, other.salt) == ("quick (changed)", "quick", "quick")
    assert [entry.label for entry in other.estimators] == ["uniform", "ridge"]
    assert other.sigmas == (0.3,)
    same = ("scenarios", "sensors", "seeds")
    assert all(getattr(other, name) == getattr(quick, name) for name in same) and not other.gate
    assert change(quick, seeds=7).seeds == 7
    assert [s.label for s in change(quick, sensors=("range_bearing",)).sensors] == ["range_bearing"]


def test_what_both_have_is_the_same_trial(quick):
    other = change(quick, estimators=("uniform", "ridge"), scenarios=("two_player",))
    trials = {trial.key: trial for trial in expand(quick)}
    common = [trial for trial in expand(other) if trial.key in trials]
    assert len(common) > 10
    assert all(trials[trial.key].code == trial.code for trial in common)


def test_a_new_scenario_lifts_limits_to_others(quick):
    limited = quick.estimators[0].model_copy(update={"scenarios": ("two_player",)})
    suite = quick.model_copy(update={"estimators": (limited, *quick.estimators[1:])})
    other = change(suite, scenarios=("highway",))
    assert other.scenarios[0].family
    assert len(other.pairs()) == 4


def test_a_folder_of_a_changed_suite_gains_levels(quick):
    first = change(quick, sigmas=(0.3,), estimators=("ridge",))
    asked = Selection(sigmas=(0.2,), estimators=("uniform",), sensors=("full",))
    both = joined(changed(quick, asked, describe_here), asked, first)
    assert both.sigmas == (0.3, 0.2)
    assert [entry.label for entry in both.estimators] == ["ridge", "uniform"]
    assert {entry.label for entry in both.sensors} == {"full", "partial"}
    assert joined(quick, Selection(), first) is quick
    assert joined(first, Selection(), None) is first


@pytest.mark.parametrize(
    ("selection", "expected"),
    [
        ({"estimators": ("unifrom",)}, "no estimator 'unifrom'; it has: .*nearest: uniform"),
        ({"sensors": ("x",)}, "no sensor 'x'; it has: full, partial; known are also: "),
        ({"scenarios": ("a.py",)}, "no scenario 'a.py'"),
        ({"sensors": ("drop",)}, "sensor 'drop' refuses its parameters"),
    ],
)
def test_what_is_unknown_is_refused(quick, selection, expected):
    with pytest.raises(UserError, match=expected):
        change(quick, **selection)


def test_a_suite_of_trials_becomes_one_of_streams_by_its_rules():
    streams = load_suite("roads", kind="streams", rules={"lag": 8})
    assert (streams.name, streams.salt, streams.kind) == ("roads (changed)", "roads", "streams")
    assert streams.rules.given == {"lag": 8} and not streams.gate
    assert read_suite_json(streams.model_dump_json()) == streams
    trials = {t.key for t in expand(load_suite("roads"), 1)}
    assert trials < {t.key for t in expand(streams, 1)}
    usual = json.loads(load_suite("roads").model_dump_json())
    assert not {"kind", "rules"} & {*usual}  # it is stored as it was before there were kinds


def test_fits_add_rows_and_change_none():
    plain = load_suite("online")
    fitted = load_suite("online", rules={"fit_every": 10})
    assert fitted.name == plain.name == "online"
    assert {*fitted.references} - {*plain.references} == {"stock_fitted"}
    assert joined(plain, Selection(), fitted) == fitted  # they go on
    run = SimpleNamespace(suite=plain.model_dump_json(), started="then")
    check_same_suite(fitted, [run], "a folder")
    for rules in ({"lag": 3}, {"deadline": 1.0}):
        other = load_suite("online", rules=rules)
        assert other.name == "online (changed)"
        with pytest.raises(UserError, match=r"its rule (lag|deadline) was the default and is"):
            check_same_suite(other.model_copy(update={"name": "online"}), [run], "a folder")


def test_references_are_in_each_part_that_names_none():
    drives = load_suite("driving")
    for wanted, found in (
        (("map",), [*REFERENCES["drives"], "map"]),
        (("oracle", "map"), ["oracle", "map"]),
        (("uniform",), ["uniform"]),
    ):
        part = select(drives, Selection(estimators=wanted))
        assert [entry.label for entry in part.estimators] == found

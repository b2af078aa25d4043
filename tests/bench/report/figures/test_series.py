import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.declaration import declare
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.report.figures import series, style

COSINE_ERROR, POSITION_ERROR = declare(CosineError), declare(PositionError)


def only(trials):
    (found,) = series.split(trials)
    return found


def test_failures_are_the_worst_errors_there_are(make_trials):
    part = {"estimators": ("a",), "sensors": ("full",), "sigmas": (0.1,), "seeds": 1}
    kinds = ("ok", "failed_forward", "not_converged", "timeout")
    found = only(pd.concat([make_trials(**part, status=kind) for kind in kinds]))
    assert np.isfinite(found.error(COSINE_ERROR)).tolist() == [True, True, False, False]
    assert np.isfinite(found.error(POSITION_ERROR)).tolist() == [True, False, False, False]
    assert found.failed.tolist() == [False, True, True, True]


def test_a_number_left_by_a_failure_is_no_result(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=1)
    found = only(trials.assign(status="not_converged", cosine_error=1e-9, position_error=1e-9))
    assert np.isinf(found.error(COSINE_ERROR)).all()
    assert np.isinf(found.error(POSITION_ERROR)).all()


def test_noise_that_was_not_measured_is_put_at_its_expectation(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), status="crash")
    noise = np.abs(0.1 * np.random.default_rng(0).standard_normal(100_000)).mean()
    assert only(trials).observation_error == pytest.approx(noise, rel=0.01)


def test_contenders_keep_their_colour_in_any_company(make_trials):
    alone = series.split(make_trials(estimators=("kkt_residual",)))
    crowd = series.split(
        make_trials(estimators=("a", "kkt_residual", "uniform", "kkt_constrained"))
    )
    colours = {(s.estimator, s.sensor): s.colour for s in crowd}
    assert [colours[s.estimator, s.sensor] for s in alone] == [s.colour for s in alone]
    assert len({s.colour for s in crowd}) == len(crowd)
    assert crowd[-1].is_floor
    assert sum(s.is_floor for s in crowd) == 1


def test_sensors_differ_in_line_style_and_repeated_colours_in_marker(make_trials):
    many = series.split(make_trials(estimators=tuple("abcdef"), sigmas=(0.1,), seeds=1))
    looks = {(s.colour, str(s.line_style), s.marker) for s in many}
    assert len(looks) == len(many) == 12
    assert len({str(s.line_style) for s in many}) == 2


def test_names_are_made_printable():
    assert style.printable("a\nb\x00c") == "a b c"
    assert style.printable("\ud800") == "(no name)"
    assert len(style.printable("x" * 99)) <= 32


def test_the_floor_is_no_contender_unless_it_is_alone(make_trials):
    part = {"sensors": ("full",), "sigmas": (0.1,), "seeds": 1}
    both = series.split(make_trials(estimators=("a", "uniform"), **part))
    assert [s.estimator for s in series.contenders(both)] == ["a"]
    alone = series.split(make_trials(estimators=("uniform",), **part))
    assert series.contenders(alone) == alone
    assert series.contenders([]) == []


def test_noise_that_was_measured_is_taken_as_it_is(make_trials):
    trials = make_trials(estimators=("a",), sensors=("full",), sigmas=(0.1,), seeds=2)
    trials["observation_error"] = [0.3, np.nan]
    assert only(trials).observation_error.tolist() == [0.3, pytest.approx(0.0798, rel=1e-3)]
    assert only(trials.assign(count=[3, 1])).count.tolist() == [3, 1]
    assert only(trials).name == "a, full"

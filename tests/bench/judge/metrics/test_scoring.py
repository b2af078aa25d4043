"""All metrics of a trial; an error names its metric."""

from types import SimpleNamespace

import numpy as np
import pytest

from olne_bench.bench.judge.metrics.cosine_error import CosineError
from olne_bench.bench.judge.metrics.covers_parameters import CoversParameters
from olne_bench.bench.judge.metrics.covers_truth import CoversTruth
from olne_bench.bench.judge.metrics.credible_level import CredibleLevel
from olne_bench.bench.judge.metrics.crps import Crps
from olne_bench.bench.judge.metrics.energy_score import EnergyScore
from olne_bench.bench.judge.metrics.held_out_error import HeldOutError
from olne_bench.bench.judge.metrics.judged import HeldOut, Judged
from olne_bench.bench.judge.metrics.position_error import PositionError
from olne_bench.bench.judge.metrics.reconstruction_error import ReconstructionError
from olne_bench.bench.judge.metrics.scoring import MetricError, score_all

ALL = (
    *(CosineError(), PositionError(), HeldOutError(), ReconstructionError(), CoversTruth()),
    *(CredibleLevel(), EnergyScore(), Crps()),
)
WEIGHTS = np.array([[0.5, 0.5], [0.2, 0.8]])


def states(offset: float = 0.0) -> np.ndarray:
    return np.full((3, 2, 4), offset)


def judged(**changes: object) -> Judged:
    recording = SimpleNamespace(
        states=states(),
        controls=np.zeros((2, 2, 2)),
        costates=np.zeros((2, 2, 4)),
        extra_state=np.zeros((2, 4)),
        scenario=SimpleNamespace(weights=WEIGHTS.copy()),
    )
    estimate = SimpleNamespace(
        weights=WEIGHTS[:, ::-1].copy(),
        states=states(2.0),
        covariance=np.eye(4),
        region="covariance",
        samples=None,
        parameter_samples=None,
    )
    fields = {"estimate": estimate, "prediction": states(1.0), "sigma": 0.1}
    return Judged(recordings=(recording,), **fields | changes)  # type: ignore[arg-type]


def test_every_metric_says_its_own():
    pairs = (HeldOut(states(), states(0.5)), HeldOut(states(), states(1.5)))
    scores = score_all(ALL, judged(held_out=lambda: pairs))
    # One player's weights are right; the other's have the cosine 0.32 / 0.68.
    assert scores.pop("cosine_error") == pytest.approx((1 - 0.32 / 0.68) / 2)
    # The other player's weights are 0.6 off, twice.
    assert scores.pop("credible_level") == pytest.approx(1 - np.exp(-0.36))
    assert scores.pop("energy_score") == pytest.approx(np.sqrt(0.72))
    assert scores.pop("crps") == pytest.approx(0.3)
    assert scores == {
        "position_error": 1.0,
        "held_out_error": 1.0,
        "reconstruction_error": 2.0,
        "covers_truth": 1.0,
    }


def test_without_a_prediction_nobody_is_asked_for_its_error():
    def lost() -> None:
        raise AssertionError("there is nothing to follow")

    scores = score_all(ALL, judged(prediction=None, held_out=lost))
    assert scores["position_error"] is scores["held_out_error"] is None
    assert scores["cosine_error"] is not None and scores["reconstruction_error"] == 2.0


def test_what_an_estimate_lacks_is_not_scored():
    bare = SimpleNamespace(
        weights=WEIGHTS.copy(),
        states=None,
        covariance=None,
        region=None,
        samples=None,
        parameter_samples=None,
    )
    scores = score_all(ALL, judged(estimate=bare))
    assert scores["reconstruction_error"] is scores["covers_truth"] is None
    assert scores["held_out_error"] is None
    assert score_all(ALL, judged(sigma=0.0))["covers_truth"] is None


@pytest.mark.parametrize(
    ("deviations", "share"),
    [([[0.2, 0.2], [0.2, np.nan]], 1.0), ([[0.2, 0.04], [0.2, np.nan]], 2 / 3), (None, None)],
)
def test_intervals_of_parameters_hold_the_truth_or_not(deviations, share):
    truth = np.array([[1.0, 2.0], [3.0, np.nan]])  # the second player has one parameter only
    case = judged()
    case.recordings[0].scenario.parameters = truth
    case.estimate.parameters = truth + 0.1
    case.estimate.parameter_deviations = None if deviations is None else np.array(deviations)
    assert CoversParameters().score(case) == (share and pytest.approx(share))
    noise_free = judged(sigma=0.0)
    noise_free.recordings[0].scenario.parameters = truth
    assert CoversParameters().score(noise_free) is None
    case.recordings[0].scenario.parameters = None
    assert CoversParameters().score(case) is None


class Odd:
    name = "odd"

    def __init__(self, answer: object) -> None:
        self.answer = answer

    def score(self, case: Judged) -> object:
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer


@pytest.mark.parametrize(
    ("answer", "expected"),
    [(None, None), (2, 2.0), (True, 1.0), (np.float32(0.5), 0.5), (np.array(3), 3.0)],
)
def test_numbers_of_all_kinds_are_numbers(answer, expected):
    found = score_all([Odd(answer)], judged())["odd"]
    assert found == expected and (found is None or type(found) is float)


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        ("1.0", "it returned a str"),
        ([1.0], "it returned a list"),
        (1j, "it returned a complex"),
        (np.ones(2), "it returned a ndarray"),
        (float("nan"), "it returned nan, expected a finite number or None"),
        (np.float64("inf"), "it returned inf"),
        (10**400, "OverflowError"),
        (ValueError("two\nlines"), "ValueError: two lines"),
        (SystemExit(3), "SystemExit: 3"),
    ],
)
def test_a_metrics_fault_is_one_line_with_its_name(answer, text):
    with pytest.raises(MetricError) as caught:
        score_all([CosineError(), Odd(answer)], judged())
    said = str(caught.value)
    assert said.startswith("metric 'odd': ") and text in said and "\n" not in said


def test_a_metric_cannot_change_the_truth():
    class Writes:
        name = "writes"

        def score(self, case: Judged) -> float:
            case.states[:] = 7
            return 0.0

    case = judged()
    with pytest.raises(MetricError, match="read-only"):
        score_all([Writes()], case)
    assert (case.states == 0).all()
    for array in (case.weights, case.estimate.weights, case.prediction):
        assert array is not None and not array.flags.writeable

"""Stacks of layers, and the sensor models that estimators get."""

import numpy as np
import pytest

from olne_bench.envs.recordings.recording import Recording
from olne_bench.envs.scenarios import get_scenario
from olne_bench.games.model.dynamics import DOUBLE_INTEGRATOR, UNICYCLE
from olne_bench.games.model.observation import ComponentView, RangeBearingView, observe
from olne_bench.games.model.sensor import (
    CorrelatedNoise,
    CovarianceNoise,
    Drops,
    GapsLayer,
    SensorModel,
)
from olne_bench.games.solve.information import (
    joint_weight_covariance,
    observation_sensitivity,
    of_seen,
    weight_covariance,
)

SCALE = (1.0, 1.0, 0.1, 2.0)
PARTIAL = ComponentView("partial", ("px", "py", "heading"))
LIDAR = RangeBearingView((-3.0, -3.0), np.pi / 4, bearing_scale=0.2)


def model(*layers, dynamics=UNICYCLE):
    return SensorModel.of(layers, dynamics, SCALE)


def test_scales_follow_the_views():
    assert model().noise_scale == SCALE
    assert model(PARTIAL).noise_scale == SCALE[:3]
    assert model(PARTIAL, LIDAR).noise_scale == (1.0, 0.2)
    wide = SensorModel.of((LIDAR,), UNICYCLE, (3.0, 3.0, 1.0, 1.0))
    np.testing.assert_allclose(wide.noise_scale, (3.0, 0.6))


def test_independent_noise_has_no_covariance_of_its_own():
    assert model(PARTIAL).noise_covariance is None
    np.testing.assert_allclose(model(PARTIAL).covariance, np.diag(np.square(SCALE[:3])))
    assert model(CorrelatedNoise(0.0)).noise_covariance is None


def test_correlation_keeps_the_scales():
    found = model(PARTIAL, CorrelatedNoise(0.5, ("px", "heading")))
    expected = [[1.0, 0.0, 0.05], [0.0, 1.0, 0.0], [0.05, 0.0, 0.01]]
    np.testing.assert_allclose(found.covariance, expected)
    assert found.noise_covariance == found.covariance
    np.testing.assert_allclose(found.noise_scale, SCALE[:3])


def test_only_views_depend_on_their_order():
    layers = (PARTIAL, CorrelatedNoise(0.5), Drops(0.1))
    assert model(*layers) == model(*layers[::-1])
    assert model(*layers).may_miss
    assert not model(PARTIAL).may_miss


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        (
            (ComponentView("x", ("px", "heading")), LIDAR),
            "view 'range_bearing': no component 'py' here; there are: px, heading",
        ),
        ((LIDAR, PARTIAL), "view 'partial': no component 'px' here; there are: range, bearing"),
        (
            (LIDAR, CorrelatedNoise(0.5, ("px",))),
            "correlated noise: no component 'px' is seen; there are: range, bearing",
        ),
        ((CorrelatedNoise(1.0),), "correlation must be above -0.333 and below 1 for 4 components"),
        ((CorrelatedNoise(-0.4),), "correlation must be above -0.333 and below 1.*got -0.4"),
        ((CorrelatedNoise(float("nan")),), "got nan"),
        ((LIDAR, CovarianceNoise(((1.0, 1.0), (1.0, 1.0)))), "positive definite"),
        ((LIDAR, CovarianceNoise(((1.0, 0.0), (0.0, -1.0)))), "has the eigenvalue -1"),
        ((LIDAR, CovarianceNoise(((1.0,),))), r"rows of \[1\] numbers, expected 2 rows of 2"),
        ((CorrelatedNoise(0.1), CorrelatedNoise(0.2)), "one noise layer at most, got 2"),
        (("full",), "'full' is not a layer of a sensor"),
    ],
)
def test_layers_that_do_not_fit_say_so_in_one_line(layers, message):
    with pytest.raises(ValueError, match=message) as error:
        model(*layers)
    assert "\n" not in str(error.value)


def test_a_view_that_the_state_does_not_have():
    with pytest.raises(ValueError, match=r"'partial': no component 'heading'.*px, py, vx, vy"):
        model(PARTIAL, dynamics=DOUBLE_INTEGRATOR)


@pytest.mark.parametrize("p", [-0.1, 1.1, float("nan")])
def test_gaps_with_no_probability(p):
    with pytest.raises(ValueError, match=f"between 0 and 1, got {p}"):
        Drops(p)


def test_drops_are_as_frequent_as_said():
    layer, rng = Drops(0.3), np.random.default_rng(0)
    assert isinstance(layer, GapsLayer)
    masks = np.array([layer.missed(rng, np.zeros((3, 2))) for _ in range(4000)])
    np.testing.assert_allclose(masks.mean(axis=0), 0.3, atol=0.03)
    assert abs(np.corrcoef(masks.T)[0, 1]) < 0.05


@pytest.fixture(scope="module")
def played(recorded) -> Recording:
    return recorded("two_player")


def _arguments(played):
    return (played.states, played.controls, played.costates, played.scenario.weights)


def test_a_diagonal_covariance_is_a_noise_scale(played):
    game = get_scenario("two_player").game
    one = weight_covariance(game, PARTIAL, *_arguments(played), noise_scale=np.array(SCALE[:3]))
    other = weight_covariance(
        game, PARTIAL, *_arguments(played), noise_covariance=np.diag(np.square(SCALE[:3]))
    )
    np.testing.assert_allclose(one, other, rtol=1e-8)


def test_information_of_correlated_noise_and_gaps(played):
    """Against J' (I x C)^-1 J, summed over the samples that were seen."""
    game = played.scenario.game
    covariance = np.array(model(LIDAR, CorrelatedNoise(0.6)).covariance)
    plain = observation_sensitivity(game, LIDAR, *_arguments(played))
    y = observe(LIDAR, game.dynamics, played.states)
    y[3:9, 0], y[20, 1] = np.nan, np.nan
    blocks = plain.reshape(-1, 2, plain.shape[1])[np.isfinite(y).all(axis=2).ravel()]
    expected = np.einsum("bip,ij,bjq->pq", blocks, np.linalg.inv(covariance), blocks)
    white = observation_sensitivity(game, LIDAR, *_arguments(played), noise_covariance=covariance)
    kept = of_seen(white, y)
    np.testing.assert_allclose(kept.T @ kept, expected, rtol=1e-8, atol=1e-6)
    bound, less = (joint_weight_covariance(game, [rows]) for rows in (white, kept))
    assert (np.diag(less) > np.diag(bound)).all()

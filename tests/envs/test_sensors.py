"""The sensors of this package: their layers, and what they refuse."""

import numpy as np
import pytest

from olne_bench.envs import olne_v0
from olne_bench.envs.sensors.correlated import Correlated
from olne_bench.envs.sensors.drop import Drop
from olne_bench.envs.sensors.full import Full
from olne_bench.envs.sensors.partial import Partial
from olne_bench.envs.sensors.range_bearing import RangeBearing
from olne_bench.envs.worlds.wrappers import AWGN, DropSamples, Gaps, PartialObservation, wrap
from olne_bench.games.model.dynamics import UNICYCLE
from olne_bench.games.model.observation import VIEWS, RangeBearingView
from olne_bench.games.model.sensor import CorrelatedNoise, CovarianceNoise, Drops, GapsLayer

ONES = np.ones(4)


def world():
    return olne_v0.parallel_env("two_player", reveal_truth=False)


def shown(env, seed=1):
    """The blocks (T, N, d) that player_1 sees while no player acts."""
    observations, _ = env.reset(seed=seed)
    frames = [observations["player_1"]]
    while env.agents:
        observations, *_ = env.step({player: np.zeros(2) for player in env.agents})
        frames.append(observations["player_1"])
    return np.array([env.observation_layout.by_index(frame, "player_1") for frame in frames])


def test_layers_are_plain_data():
    assert Full().layers() == (VIEWS["full"],)
    assert Partial().layers() == (VIEWS["partial"],)
    assert RangeBearing([1, 2], 0.5).layers() == (RangeBearingView((1.0, 2.0), 0.5, 0.1),)
    assert RangeBearing().layers() == (RangeBearingView((0.0, 0.0), 0.0, 0.1),)
    assert Drop(0.3).layers() == (Drops(0.3),)
    assert Correlated(0.2, ["px", "py"]).layers() == (CorrelatedNoise(0.2, ("px", "py")),)
    assert Correlated(covariance=[[1, 0], [0, 2]]).layers() == (
        CovarianceNoise(((1.0, 0.0), (0.0, 2.0))),
    )


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Partial(()), r"components must be a list of different names, got \(\)"),
        (lambda: Partial("px"), "different names, got 'px'"),
        (lambda: Partial(["px", "px"]), "different names"),
        (lambda: Partial([1]), "different names"),
        (lambda: RangeBearing(position=3), "position must be px and py, got 3"),
        (lambda: RangeBearing(position=(1, "a")), "position must be px and py"),
        (lambda: RangeBearing(position=(1, 2, 3)), "position must be px and py"),
        (lambda: RangeBearing(bearing_scale=-1), "bearing_scale must be above 0"),
        (lambda: Drop("often"), "p must be a probability between 0 and 1, got 'often'"),
        (lambda: Drop(True), "got True"),
        (lambda: Drop(2), "between 0 and 1, got 2"),
        (lambda: Correlated("much"), "correlation must be a number"),
        (lambda: Correlated(covariance=[1, 2]), "covariance rows of numbers"),
        (lambda: Correlated(components="px"), "components must be a list of names, got 'px'"),
    ],
)
def test_parameters_that_make_no_sense(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_wrapped_world_wears_the_wrappers_of_its_layers():
    layers = (*Drop(0.3).layers(), *Partial().layers())  # the order of kinds does not matter
    wrapped = wrap(world(), layers, 0.1, ONES)
    by_hand = DropSamples(AWGN(PartialObservation(world(), ("px", "py", "heading")), 0.1), 0.3)
    np.testing.assert_array_equal(shown(wrapped), shown(by_hand))
    assert wrapped.observation_layout.state_names == ("px", "py", "heading")


def test_correlated_noise_is_mixed_in_the_order_of_components():
    covariance = 0.01 * np.array([[1.0, 0.7, 0.7], [0.7, 1.0, 0.7], [0.7, 0.7, 1.0]])
    layers = (*Partial().layers(), *Correlated(0.7).layers())
    by_hand = AWGN(PartialObservation(world(), ("px", "py", "heading")), covariance=covariance)
    np.testing.assert_allclose(shown(wrap(world(), layers, 0.1, ONES)), shown(by_hand), atol=1e-12)
    wider = shown(wrap(world(), Correlated(0.7).layers(), 0.1, ONES))
    np.testing.assert_allclose(wider[..., :3], shown(by_hand), atol=1e-12)


@pytest.mark.parametrize("sigma", [-1.0, float("nan"), float("inf")])
def test_a_level_out_of_range(sigma):
    with pytest.raises(ValueError, match="sigma must be finite and non-negative"):
        wrap(world(), Full().layers(), sigma, ONES)


def test_layers_that_do_not_fit_the_world():
    with pytest.raises(ValueError, match="no component 'lane' here"):
        wrap(world(), Partial(["px", "lane"]).layers(), 0.1, np.ones(UNICYCLE.state_size))


class Far(GapsLayer):
    """A sensor that does not see players to the right of a line."""

    def missed(self, rng, blocks):
        return blocks[:, 0] > -0.5


def test_gaps_of_ones_own_look_at_what_is_seen():
    exact, seen = shown(world()), shown(wrap(world(), (Far(),), 0.0, ONES))
    np.testing.assert_array_equal(np.isnan(seen[..., 0]), exact[..., 0] > -0.5)
    assert 0 < np.isnan(seen).mean() < 1


def test_a_mask_of_a_wrong_shape_is_named():
    class Wrong(GapsLayer):
        def missed(self, rng, blocks):
            return np.zeros(3, dtype=bool)

    with pytest.raises(ValueError, match=r"mask of the shape \(3,\), expected \(2,\)"):
        Gaps(world(), Wrong()).reset(seed=0)


def test_two_kinds_of_gaps_do_not_share_a_stream():
    twice = wrap(world(), (Drops(0.5), Drops(0.5)), 0.0, ONES)
    missing = np.mean([np.isnan(shown(twice, seed)).mean() for seed in range(30)])
    assert missing == pytest.approx(0.75, abs=0.04)

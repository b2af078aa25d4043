import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from olne_bench.bench.judge.metrics import cosine_error, identifiable_cosine_error, position_error

weights = arrays(float, (3, 4), elements=st.floats(0.01, 10))
scales = arrays(float, (3, 1), elements=st.floats(0.01, 100))
deterministic = settings(derandomize=True, deadline=None)


@deterministic
@given(weights, weights, scales)
def test_cosine_error_ignores_each_players_scale(true, estimated, scale):
    expected = cosine_error(true, estimated)
    assert cosine_error(true, scale * estimated) == pytest.approx(expected, abs=1e-12)


@deterministic
@given(weights, weights, st.permutations(range(3)))
def test_cosine_error_ignores_the_order_of_players(true, estimated, order):
    expected = cosine_error(true, estimated)
    assert cosine_error(true[order], estimated[order]) == pytest.approx(expected, abs=1e-12)


@deterministic
@given(weights, weights)
def test_cosine_error_of_non_negative_weights_lies_between_0_and_1(true, estimated):
    assert 0 <= cosine_error(true, estimated) <= 1
    assert cosine_error(true, true) == pytest.approx(0, abs=1e-12)


def test_cosine_error_by_hand():
    assert cosine_error(np.array([[1.0, 0.0]]), np.array([[1.0, 1.0]])) == pytest.approx(
        1 - np.sqrt(0.5)
    )


def test_position_error_looks_at_positions_only():
    states = np.zeros((5, 2, 4))
    other = states.copy()
    other[..., 2:] = 9
    other[..., 0] = 0.5
    assert position_error(states, other) == pytest.approx(0.25)


projections = np.stack([np.eye(4) - 0.25] * 3)


@deterministic
@given(weights, weights, scales)
def test_with_all_identified_the_identifiable_error_is_the_plain_one(true, estimated, scale):
    found = identifiable_cosine_error(true, (scale * estimated)[None], projections)
    assert found == pytest.approx(cosine_error(true, estimated), abs=1e-9)


@deterministic
@given(weights, weights, st.permutations(range(3)))
def test_identifiable_error_ignores_scale_and_order_of_players(true, estimated, order):
    yaw_unseen = np.array([[0.5, -0.5, 0, 0], [1 / 6, 1 / 6, -1 / 3, 0]])
    basis = np.linalg.qr(yaw_unseen.T)[0]
    some = np.stack([basis @ basis.T, projections[0], np.zeros((4, 4))])
    found = identifiable_cosine_error(true, estimated[None], some)
    again = identifiable_cosine_error(true[order], 7 * estimated[order][None], some[order])
    assert again == pytest.approx(found, abs=1e-9)


@deterministic
@given(weights, weights)
def test_where_nothing_is_identified_all_errors_are_forgiven(true, estimated):
    found = identifiable_cosine_error(true, estimated[None], np.zeros((3, 4, 4)))
    assert found == pytest.approx(0, abs=1e-12)

"""Buffered functions give what plain calls give."""

import copy
import pickle

import casadi as ca
import numpy as np
import pytest

from olne_bench.games.compiled.buffered import BufferedFunction
from olne_bench.games.model.dynamics import UNICYCLE, numeric_step


@pytest.fixture
def step():
    return BufferedFunction(numeric_step(UNICYCLE, 0.1).map(3))


def test_same_bits_as_a_plain_call(step):
    rng = np.random.default_rng(0)
    for _ in range(5):
        states, controls = rng.standard_normal((3, 4)), rng.standard_normal((3, 2))
        plain = np.array(numeric_step(UNICYCLE, 0.1)(states.T, controls.T)).T
        assert np.array_equal(step(states, controls), plain)


def test_results_and_arguments_are_not_shared(step):
    states, controls = np.ones((3, 4)), np.ones((3, 2))
    first = step(states, controls)
    kept = first.copy()
    step(5 * states, controls)
    assert np.array_equal(first, kept)
    assert (states == 1).all()


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda f: pickle.loads(pickle.dumps(f))])
def test_copies_have_memory_of_their_own(step, duplicate):
    other = duplicate(step)
    states, controls = np.ones((3, 4)), np.ones((3, 2))
    expected = step(states, controls)
    step(0 * states, controls)
    assert np.array_equal(other(states, controls), expected)


def test_sparse_functions_are_refused():
    x = ca.SX.sym("x", 2)
    with pytest.raises(ValueError, match="not dense"):
        BufferedFunction(ca.Function("f", [x], [ca.diag(x)]))

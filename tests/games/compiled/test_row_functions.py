"""Functions of rows give what plain calls give, compiled or not."""

import casadi as ca
import numpy as np
import pytest

from olne_bench.games.compiled import compiler
from olne_bench.games.compiled.row_functions import RowFunction, row_functions


def functions() -> list[ca.Function]:
    """A function of vectors, and one of a vector and a matrix whose result is a matrix."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u", 2)
    cost = ca.Function("cost", [x, u], [ca.vertcat(ca.sin(x[0]) * u[1], ca.dot(x, x) / u[0])])
    step = ca.Function("step", [x, u], [x + ca.vertcat(u, ca.exp(u[0]))])
    return [cost, step.mapaccum("motion", 4)]


@pytest.fixture(params=["compiled", "CasADi"])
def rows(request, monkeypatch):
    if request.param == "CasADi":
        monkeypatch.setattr(compiler, "load", lambda _: None)
    return row_functions(functions())


def test_each_row_is_a_plain_call(rows):
    rng = np.random.default_rng(0)
    cost, motion = functions()
    for count in (1, 5, 2):
        x, u = rng.uniform(1, 2, (count, 3)), rng.uniform(1, 2, (count, 2))
        expected = [np.array(cost(*pair)).ravel() for pair in zip(x, u, strict=True)]
        assert np.allclose(rows[0](x, u), expected, rtol=1e-14, atol=0)
        u = rng.uniform(0, 1, (count, 4, 2))
        expected = [
            np.array(motion(*pair)).T.ravel() for pair in zip(x, u.swapaxes(1, 2), strict=True)
        ]
        assert np.allclose(rows[1](x, u), expected, rtol=1e-14, atol=0)


def test_other_types_and_strides_are_brought_to_doubles(rows):
    x, u = np.arange(1, 13).reshape(4, 3), np.ones((4, 2), dtype=np.float32)
    expected = rows[0](x.astype(float), u.astype(float))
    assert np.array_equal(rows[0](x, u), expected)
    assert np.array_equal(rows[0](np.asfortranarray(x), u), expected)
    assert np.array_equal(rows[0](x[::2], u[::2]), expected[::2])


def test_results_are_not_shared(rows):
    x, u = np.ones((2, 3)), np.ones((2, 2))
    first = rows[0](x, u)
    kept = first.copy()
    rows[0](5 * x, u)
    assert np.array_equal(first, kept)


def test_no_rows_are_no_results(rows):
    assert rows[0](np.empty((0, 3)), np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("shapes", [((2, 4), (2, 2)), ((2, 3), (3, 2)), ((2, 3),)])
def test_wrong_shapes_are_refused(rows, shapes):
    with pytest.raises(ValueError, match=r"reshape|argument"):
        rows[0](*map(np.ones, shapes))


def test_sparse_functions_are_refused():
    x = ca.SX.sym("x", 2)
    with pytest.raises(ValueError, match="not dense"):
        RowFunction(ca.Function("f", [x], [ca.diag(x)]), None)

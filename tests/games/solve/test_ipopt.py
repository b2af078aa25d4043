"""Options that every use of IPOPT shares."""

import casadi as ca
import pytest

from olne_bench.games.solve.ipopt import QUIET


def test_ipopt_says_nothing_and_raises_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    x = ca.SX.sym("x")
    good = ca.nlpsol("good", "ipopt", {"x": x, "f": (x - 1) ** 2}, QUIET)
    assert float(good(x0=3.0)["x"]) == pytest.approx(1)
    limited = QUIET | {"ipopt.max_iter": 2}
    bad = ca.nlpsol("bad", "ipopt", {"x": x, "f": ca.exp(-x)}, limited)
    bad(x0=0.0)
    assert not bad.stats()["success"]
    said = capfd.readouterr()
    assert said.out + said.err == ""

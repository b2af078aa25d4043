"""Which cars are predicted, and what is known of them at their moments."""

import shutil

import numpy as np
import pandas as pd
import pytest

from olne_bench.bench.people.cases import (
    CALM,
    CLOSING,
    HORIZONS,
    IMPERFECT,
    WAVE,
    cases_in,
    sources,
)


def cases(data, weights=False):
    return [
        case
        for one in sources(sorted(data.glob("*.csv")), "csv")
        for case in cases_in(one, weights)
    ]


def test_each_car_with_a_leader_counts_once(data):
    found = cases(data)
    assert len(found) == 16  # two of three cars in eight files
    assert {case.road for case in found} == {"Lane"} and len({c.piece for c in found}) == 8
    # The same motion in another file, moved and later, is neither new nor another piece.
    again = pd.read_csv(data / "A_Lane-0_1.csv")
    again = again.assign(time=again["time"] + 100.0, x=again["x"] + 7.0)
    again.to_csv(data / "A_Lane-9_1.csv", index=False)
    shutil.copy(data / "A_Lane-0_1.toml", data / "A_Lane-9_1.toml")
    assert len(cases(data)) == 16
    assert [one.piece for one in sources(sorted(data.glob("*.csv")), "csv")][-1] == "A_Lane-0_1.csv"


def test_places_are_since_the_moment_and_the_future_is_not_known_then(data):
    before = cases(data)[0]
    path = data / "A_Lane-0_1.csv"
    table = pd.read_csv(path)
    late = table["time"] > 2.8
    table.loc[late, "x"] += 3 * (table["time"] - 2.8)
    table.to_csv(path, index=False)
    after = cases(data)[0]
    moved = after.happened - before.happened
    assert moved[:, 0] == pytest.approx(3 * np.array(HORIZONS[: len(moved)]), abs=0.7)
    for method in ("straight", "controls", "game", "alone"):
        assert after.predicted[method] == pytest.approx(before.predicted[method], abs=1e-9)
    assert after.speeds == pytest.approx(before.speeds) and after.kind == before.kind
    assert after.predicted["intent"][2, 0] > before.predicted["intent"][2, 0]  # knows the future


def test_kinds_are_of_speeds_at_the_moment(data):
    for case in cases(data):
        own, ahead = case.speeds[0] - case.speeds[1], case.speeds[1:3]
        waves = len(ahead) == 2 and abs(ahead[0] - ahead[1]) > 2
        assert case.kind == (WAVE if waves else CLOSING if own > 1.5 else CALM)


@pytest.mark.long
def test_weights_of_its_own_explain_what_was_seen(data):
    for path in sorted(data.glob("*"))[2:]:
        path.unlink()
    for case in cases(data, weights=True):
        assert case.residual < 0.3 and case.seconds > 0
        count = len(case.speeds)
        assert case.samples.shape[1:] == (count, 4) and (case.samples > 0).all()
        assert case.sampled.shape == (len(case.samples), *case.happened.shape)
        assert case.predicted["own weights"].shape == case.happened.shape
        assert case.predicted[IMPERFECT] == pytest.approx(case.sampled.mean(axis=0))

"""A suite has the same rows however it is run.

The rows of a Dask cluster are compared in ``test_cluster.py``.
"""

import pandas as pd
import pytest


@pytest.mark.long
def test_rows_do_not_depend_on_how_they_came_about(study):
    study.run("one", "Drawn")
    whole = study.rows("one")
    assert len(whole) == 2 * 2 * 4
    study.run("two", "Drawn", options=("--jobs", "2"))
    for half, options in (("a", ("--sigma", "0.01")), ("b", ("--sigma", "0.1"))):
        study.run(half, "Drawn", options=options)
    folders = [study.folder / name for name in ("a", "b", "halves")]
    study.call("merge", *folders[:2], "--out", folders[2])
    for way in ("two", "halves"):
        pd.testing.assert_frame_equal(study.rows(way), whole, check_exact=True, obj=way)

"""The rows of online studies: one for each sample of each motion."""

from dataclasses import fields
from typing import Any

import msgspec
import pandas as pd

from olne_bench.bench.judge.online import ERROR_COLUMNS, Update
from olne_bench.bench.plan.motion import REFERENCES
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.plan.trial import KEY_COLUMNS
from olne_bench.bench.run.store import Store

Row = dict[str, Any]

#: Columns of a row: what identifies the motion and the estimator, the update, and its errors.
COLUMNS = (
    *KEY_COLUMNS,
    *(field.name for field in fields(Update) if field.name != "errors"),
    *ERROR_COLUMNS,
)


def update_table(store: Store, suite: Suite) -> pd.DataFrame:
    """A row for each sample of each motion in a store, with ``COLUMNS``.

    A motion that an estimator did not follow has one row, whose ``sample`` is 0. The order is that
    of the suite, whenever rows were written.

    Args:
        store: motions that ended.
        suite: says what comes first; what it does not have comes last.
    """
    rows: list[Row] = []
    for batch in store.batches():
        for record in batch.to_pylist():
            nothing = record["extras"] is None and record["status"] == "skipped"
            if not (nothing and record["estimator"] in REFERENCES):
                rows += _rows_of(record)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    places = pd.DataFrame(
        {
            "scenario": _places(table["scenario"], [one.label for one in suite.scenarios]),
            "sensor": _places(table["sensor"], [one.label for one in suite.sensors]),
            "sigma": table["sigma"],
            "seed": table["seed"],
            "estimator": _places(table["estimator"], [one.label for one in suite.estimators]),
            "sample": table["sample"],
        }
    )
    order = places.sort_values(list(places.columns), kind="stable").index
    return table.loc[order].reset_index(drop=True)


def _places(labels: pd.Series, known: list[str]) -> pd.Series:
    return labels.map({label: k for k, label in enumerate(known)}).fillna(len(known))


def _rows_of(record: Row) -> list[Row]:
    labels = {name: record[name] for name in KEY_COLUMNS}
    if record["extras"] is None:
        told = {"sample": 0, "status": record["status"], "message": record["message"]}
        return [labels | told | {"late": False}]
    rows = []
    for update in msgspec.json.decode(record["extras"]):
        errors = update.pop("errors")
        rows.append(labels | update | errors)
    return rows

"""The metadata of what others may cite."""

import hashlib
import json
from pathlib import Path

import mlcroissant
import pytest

HOME = Path(__file__).parents[1] / "results" / "dataset"
#: mlcroissant uses what rdflib and pandas deprecate.
pytestmark = [
    pytest.mark.filterwarnings("ignore:ConjunctiveGraph:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore:The inplace keyword"),
]
FILES = json.loads((HOME / "croissant.json").read_text())["distribution"]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file["contentUrl"])
def test_files_are_those_that_the_metadata_names(file) -> None:
    found = hashlib.sha256((HOME / file["contentUrl"]).read_bytes()).hexdigest()
    assert found == file["sha256"], "run: python scripts/dataset.py write"


def test_the_metadata_is_valid_and_every_table_of_trials_is_in_it() -> None:
    metadata = mlcroissant.Dataset(jsonld=str(HOME / "croissant.json")).metadata
    tables = {path.parent.name for path in HOME.parent.glob("*/trials.parquet")}
    assert {one.uuid for one in metadata.record_sets} == {"draws", *(f"trials_{t}" for t in tables)}


def test_every_table_of_trials_says_who_was_run_where() -> None:
    metadata = mlcroissant.Dataset(jsonld=str(HOME / "croissant.json")).metadata
    for table in metadata.record_sets[1:]:
        names = {field.name.rpartition("/")[2] for field in table.fields}
        assert {"scenario", "sensor", "sigma", "seed", "estimator", "status"} <= names


def test_draws_have_weights_and_states_of_every_player() -> None:
    (rows,) = [one for one in FILES if one["contentUrl"] == "draws.parquet"]
    read = mlcroissant.Dataset(jsonld=str(HOME / "croissant.json")).records("draws")
    first = next(iter(read))
    weights = json.loads(first["draws/weights"])
    assert rows and len(weights) == first["draws/players"]
    assert len(json.loads(first["draws/states"])) == first["draws/samples"]
    assert all(abs(sum(row) - 1) < 1e-9 for row in weights)

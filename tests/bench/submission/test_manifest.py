"""Manifests: read strictly, within bounds, and refused in one line."""

import json
from pathlib import Path
from typing import Any

import pytest

from olne_bench.bench.plan.select import Selection
from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.submission.files import digest
from olne_bench.bench.submission.manifest import (
    MANIFEST,
    MOST_RUNS,
    ROWS,
    check_labels,
    check_name,
    manifest_text,
    read_submission,
)
from olne_bench.errors import UserError

SUITE = {"name": "s", "scenarios": ["two_player"], "sensors": ["full"], "sigmas": [0.1], "seeds": 2}


def suite(**changes: object) -> Suite:
    return Suite.model_validate(SUITE | {"estimators": ["uniform"]} | changes)


def run(**changes: Any) -> Provenance:
    usual: dict[str, Any] = {
        "started": "2026-01-01T00:00:00+00:00",
        "suite": suite().model_dump_json(),
        "suite_text": "",
        "selection": Selection(),
        "seeds": 2,
        "executor": "",
        "versions": {},
        "environment": {"numpy": "2.0"},
        "commit": "",
        "machine": {},
    }
    return Provenance(**(usual | changes))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / ROWS).write_bytes(b"rows")
    files = {ROWS: digest(b"rows")}
    (tmp_path / MANIFEST).write_text(manifest_text("mine", [run()], files))
    return tmp_path


def change(folder: Path, **changes: Any) -> None:
    data = json.loads((folder / MANIFEST).read_text())
    for key, value in changes.items():
        if key in data["runs"][0]:
            data["runs"][0][key] = value
        else:
            data[key] = value
    (folder / MANIFEST).write_text(json.dumps(data))


def refused(folder: Path) -> str:
    with pytest.raises(UserError) as caught:
        found = read_submission(folder)
        found.suites(folder)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 700
    return text


def test_what_is_written_is_read(folder: Path) -> None:
    found = read_submission(folder)
    assert (found.name, found.runs) == ("mine", (run(),))
    assert [s.name for s in found.suites(folder)] == ["s"]
    change(folder, later="fields that later versions add are ignored")
    assert read_submission(folder).runs == (run(),)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"name": "x" * 5000}, "name 'xxx"),
        ({"name": "a/b"}, "a name has 1 to 60 of a-z"),
        ({"name": ["mine"]}, "name is not a text"),
        ({"format": "9" * 5000}, "has the format '999"),
        ({"files": ["a"]}, "files is not a table"),
        ({"files": {f"f{k}": "0" * 64 for k in range(501)}}, "files is not a table of at most 500"),
        ({"files": {"x" * 5000: "0" * 64}}, "is not a file within a submission"),
        ({"files": {ROWS: "0"}}, "the SHA-256 of 'trials.parquet' is '0'"),
        ({"files": {ROWS: 7}}, "the SHA-256 of 'trials.parquet' is 7"),
        ({"files": {}}, f"names no {ROWS}"),
        ({"runs": []}, "names no run"),
        ({"runs": {}}, f"runs is not a list of at most {MOST_RUNS}"),
        ({"runs": [{}] * (MOST_RUNS + 1)}, f"runs is not a list of at most {MOST_RUNS}"),
        ({"runs": [7]}, "is not the manifest of a submission"),
        ({"seeds": -1}, "a run has -1 seeds"),
        ({"seeds": 1.5}, "is not the manifest"),
        ({"seeds": "2"}, "is not the manifest"),
        ({"environment": {"numpy": 2}}, "is not the manifest"),
        ({"selection": {"sigmas": [-1.0]}}, "is not the manifest"),
        ({"suite": 7}, "is not the manifest"),
        ({"suite": "{"}, "is not the manifest"),
        ({"suite": "[" * 200_000}, "nested too deep"),
        ({"suite": '{"name": "a", "name": "b"}'}, "a key stands there twice"),
        ({"suite": "{}"}, "cannot be read: it is damaged"),
    ],
)
def test_each_field_has_a_form(folder: Path, changes: dict, said: str) -> None:
    change(folder, **changes)
    assert said in refused(folder)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"[" * 200_000, "nested too deep"),
        (b'{"a":' * 200_000, "nested too deep"),
        (b"\xff\xfe", "is not the manifest of a submission: UnicodeDecodeError"),
        (b'{"format": 1, "format": 1}', "a key stands there twice"),
        (b'{"format": NaN}', "NaN is not a number"),
        (b'{"format": -Infinity}', "-Infinity is not a number"),
        (b'{"format": 1' + b"0" * 5000 + b"}", "is not the manifest"),
        (b"[]", "it is not an object"),
        (b"", "is not the manifest"),
        (b"\0" * 1000, "is not the manifest"),
        (b"x" * 5_000_001, "submission.json has 5000001 bytes; at most 5000000 are allowed"),
    ],
)
def test_what_is_no_manifest_is_told_in_one_line(folder: Path, text: bytes, said: str) -> None:
    (folder / MANIFEST).write_bytes(text)
    assert said in refused(folder)


def test_where_there_is_none_it_is_said(tmp_path: Path) -> None:
    assert "no submission in" in refused(tmp_path)
    assert "no submission in" in refused(tmp_path / "nowhere")
    (tmp_path / "file").touch()
    assert "no submission in" in refused(tmp_path / "file")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"scenarios": ["scene.py"]}, "scene.py is a plugin that others' estimators"),
        ({"sensors": ["scene.py"]}, "scene.py is a plugin"),
        ({"metrics": ["scene.py"]}, "scene.py is a plugin"),
        ({"estimators": ["installed"]}, "neither of this package nor a file of the submission"),
        ({"estimators": ["/etc/mine.py"]}, "the plugin /etc/mine.py of estimator '' is missing"),
        ({"estimators": ["../mine.py"]}, "is missing"),
        ({"estimators": ["plugins/mine.py"]}, "is missing"),
    ],
)
def test_a_submission_names_no_other_code(folder: Path, changes: dict, said: str) -> None:
    change(folder, suite=suite(**changes).model_dump_json())
    assert said in refused(folder)


@pytest.mark.parametrize(
    ("entry", "taken"),
    [
        ({"name": "uniform", "label": "uniform"}, True),
        ({"name": "uniform", "label": "mine"}, True),
        ({"name": "ukf", "label": "ukf, peeks", "parameters": {"peek": True}}, True),
        ({"name": "mine.py", "label": "mine"}, True),
        ({"name": "mine.py", "label": "map"}, False),
        ({"name": "uniform", "label": "map"}, False),
        ({"name": "ukf", "label": "ukf", "parameters": {"peek": True}}, False),
    ],
)
def test_a_label_does_not_claim_to_be_another_estimator(entry: dict, taken: bool) -> None:
    one = suite(estimators=[entry])
    if taken:
        check_labels(one)
    else:
        with pytest.raises(UserError, match="give it another label"):
            check_labels(one)


def test_names_are_checked_for_whoever_asks() -> None:
    check_name("a_1.b-c", "--name")
    with pytest.raises(UserError, match=r"^--name 'A': a name has"):
        check_name("A", "--name")

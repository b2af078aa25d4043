"""Provenance of rows, and how a store holds it."""

import json
import os
import platform
import subprocess
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import psutil
import pytest

from olne_bench.bench.plan.select import Selection
from olne_bench.bench.run.provenance import (
    Provenance,
    provenance,
    provenance_json,
    read_provenance,
)
from olne_bench.errors import UserError


@pytest.fixture(scope="module")
def source() -> Provenance:
    selection = Selection(scenarios=("two_player",), sigmas=(0.1,))
    return provenance(suite="{}", suite_text="", selection=selection, seeds=2, executor="here")


def test_it_is_of_this_machine_and_this_moment(source: Provenance) -> None:
    assert source.machine["cores"] == str(os.cpu_count())
    size, unit = source.machine["memory"].split()
    assert unit == "GiB"
    assert float(size) == pytest.approx(psutil.virtual_memory().total / 1024**3, abs=0.06)
    started = datetime.fromisoformat(source.started)
    assert 0 <= (datetime.now(UTC) - started).total_seconds() < 600


def test_it_has_the_versions_of_what_the_package_requires(source: Provenance) -> None:
    assert source.versions["python"] == platform.python_version()
    assert source.versions["numpy"] == np.__version__
    assert "pytest" not in source.versions  # needed by its tests only


def test_it_names_the_commit() -> None:
    folder = Path(__file__).parent
    command = ["git", "rev-parse", "HEAD"]
    found = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    made = provenance(suite="", suite_text="", selection=Selection(), seeds=1, executor="")
    assert made.commit.removesuffix("-dirty") == found.stdout.strip()


def test_what_is_stored_is_read_back(source: Provenance) -> None:
    assert read_provenance(provenance_json(source)) == source
    later = json.loads(provenance_json(source)) | {"later": 1}
    assert read_provenance(json.dumps(later)) == source
    assert read_provenance(provenance_json(replace(source, seeds=3))) != source


@pytest.mark.parametrize("text", ["", "[]", "{}", "3"])
def test_what_is_no_provenance_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="cannot be read"):
        read_provenance(text)

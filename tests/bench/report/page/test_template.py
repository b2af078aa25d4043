"""What all pages share."""

from email.message import Message
from importlib.metadata import PackageNotFoundError

import pytest

from olne_bench.bench.report.page import template


def test_links_are_those_that_the_package_states(monkeypatch: pytest.MonkeyPatch) -> None:
    stated = Message()
    stated["Project-URL"] = "Documentation, https://olne.example/docs"
    stated["Project-URL"] = "Source, https://olne.example/source"
    stated["Project-URL"] = "Elsewhere, javascript:alert(1)"
    monkeypatch.setattr(template, "metadata", lambda _: stated)
    assert template.project_links() == {
        "Documentation": "https://olne.example/docs",
        "Source": "https://olne.example/source",
    }


def test_a_package_that_is_not_installed_states_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> Message:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(template, "metadata", missing)
    assert template.project_links() == {}


def test_parts_of_the_script_share_one_scope() -> None:
    text = template.script(("look", "tables"))
    assert text.startswith('"use strict";')
    assert text.count("(async () => {\n/*") == 1
    assert "function setUpTables(" in text
    assert "&lt;" not in text

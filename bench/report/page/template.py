"""What all pages share: style, script, filters, links."""

import gzip
import json
from base64 import b64encode
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from olne_bench.bench.plan.suite import Suite
from olne_bench.bench.report.escapes import csv_safe
from olne_bench.bench.report.page.cards import FIELDS
from olne_bench.bench.run.provenance import Provenance

_FOLDER = Path(__file__).parent
_DISTRIBUTION = "olne-bench"


def template(name: str) -> Template:
    """A template of this folder, with the shared filters and globals."""
    environment = Environment(
        loader=FileSystemLoader(_FOLDER), autoescape=True, undefined=StrictUndefined
    )
    environment.filters |= {"moment": _moment, "packed": _packed}
    environment.globals |= {"css": _own("page.css"), "links": project_links(), "now": _now}
    return environment.get_template(name)


def script(names: Iterable[str]) -> Markup:
    """Files of ``script/``, joined in one scope."""
    parts = Markup("\n").join(_own(f"script/{name}.js") for name in names)
    return Markup('"use strict";\n(async () => {\n') + parts + Markup("})();")


def csv_texts(tables: Mapping[str, pd.DataFrame]) -> dict[str, str]:
    """Tables as CSV, as in the run folder, to be saved from the page."""
    return {name: csv_safe(table).to_csv(index=False) for name, table in tables.items()}


def lead_of(description: str, lead: str) -> str:
    """What the head of a page says: the suite's description, if it has one, and how to read it."""
    return f"{description.rstrip('.')}. {lead}" if description else lead


def repeats(run: Provenance, suite: Suite) -> str:
    """The command that repeats a run of a suite."""
    words = [f"olne-bench run {suite.origin}", str(run.selection)]
    if suite.name != suite.origin:
        words.append(f"--kind {suite.kind}")
    words += [f"--rule {name}={json.dumps(value)}" for name, value in suite.rules.given.items()]
    return " ".join(word for word in [*words, "--out DIR"] if word)


def project_links() -> dict[str, str]:
    """Project URLs of the installed package by label; empty if it is not installed."""
    try:
        stated = metadata(_DISTRIBUTION).get_all("Project-URL") or []
    except PackageNotFoundError:  # run from a folder that was never installed
        return {}
    pairs = (line.partition(",") for line in stated)
    found = {label.strip(): url.strip() for label, _, url in pairs}
    return {label: url for label, url in found.items() if url.startswith("https://")}


def _own(name: str) -> Markup:
    """A file of this folder, which goes into the page unescaped."""
    return Markup((_FOLDER / name).read_text(encoding="utf-8"))


def _packed(data: Any) -> str:
    """Data for the script as compressed JSON, a third of the bytes."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return b64encode(gzip.compress(text.encode(), mtime=0)).decode()


def _now() -> str:
    return f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC"


def _moment(text: str) -> str:
    """A time as stored, for people."""
    return f"{datetime.fromisoformat(text).astimezone(UTC):%Y-%m-%d %H:%M} UTC"


#: Scripts of a page, in this order; the last one starts it.
_SCRIPTS = ("look", "tables", "scenes", "player", "main")


def study_page(**content: Any) -> str:
    """The page of a study as HTML, from what ``study.html`` shows.

    All but ``title, lead, facts, sections, board, runs, data`` is empty by default.
    """
    empty: dict[str, Any] = {"verdict": "", "what": "", "command": "", "scenes": False}
    lists = ("scenarios", "remarks", "pictures", "more", "details", "cards", "missing")
    empty |= {name: [] for name in lists} | {"drawn": False, "fields": FIELDS}
    return template("study.html").render(script=script(_SCRIPTS), **empty | content)

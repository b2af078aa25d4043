"""``olne-bench merge``: merge two runs into one."""

import shutil
from pathlib import Path

import click

from olne_bench.bench.commands.online_rules import SETTINGS, read_rules
from olne_bench.bench.run.provenance import Provenance
from olne_bench.bench.run.resume import check_same_suite, last_suite
from olne_bench.bench.run.store import open_store, read_store, store_name
from olne_bench.bench.run.store_layout import MOTIONS_NAME
from olne_bench.errors import UserError
from olne_bench.files import check_folder, whole_folder


def merge(first: Path, second: Path, out: Path | None) -> None:
    """Add the trials of the run in SECOND to those of the run in FIRST."""
    if first.resolve() == second.resolve():
        raise UserError(f"cannot merge {first} with itself")
    name = _same_kind(first, second)
    former, latest = _runs(first, name), _runs(second, name)
    last_suite(former, first)  # refuses a folder without a run
    check_same_suite(last_suite(latest, second), former, first, f"leave {second} on its own")
    if out is None:
        _say(first, _added(first, [second], name))
        return
    check_folder(out, (name,))
    if (out / name).exists():
        raise UserError(f"--out {out} holds a run already; name a new folder")
    with whole_folder(out) as unfinished:
        said = _added(unfinished, [first, second], name)
        if name == MOTIONS_NAME:
            shutil.copyfile(first / SETTINGS, unfinished / SETTINGS)
    _say(out, said)


def _same_kind(first: Path, second: Path) -> str:
    """Name of the stores in both folders.

    Raises:
        UserError: if one is a run and the other a study online, or their rules differ.
    """
    name, other = store_name(first), store_name(second)
    if name != other:
        online = first if name == MOTIONS_NAME else second
        raise UserError(f"cannot merge {first} with {second}: {online} is a study online")
    if name == MOTIONS_NAME and (one := read_rules(first)) != (two := read_rules(second)):
        raise UserError(f"{first} and {second} have different rules: {one} and {two}")
    return name


def _runs(folder: Path, name: str) -> list[Provenance]:
    with read_store(folder, name) as store:
        store.check()  # before anything is written
        return store.runs()


def _added(target: Path, sources: list[Path], name: str) -> list[str]:
    """Add rows to a run; a text on what came from each source."""
    said = []
    with open_store(target, name) as store:
        for source in sources:
            with open_store(source, name):  # no other process writes to it meanwhile
                new, known = store.merge(source / name)
            kept = f", {known} were there before" if known else ""
            said.append(f"{new} rows of {source} added{kept}")
    return said


def _say(target: Path, said: list[str]) -> None:
    for line in said:
        click.echo(f"{target}: {line}")

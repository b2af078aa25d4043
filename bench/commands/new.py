"""``olne-bench new``: the folder of an estimator that works, to start from."""

import keyword
from importlib.resources import files
from pathlib import Path
from string import Template

import click

from bench.errors import UserError
from estimators.registry import estimator_names

#: Template and the file that it becomes.
_FILES = {
    "pyproject.toml.txt": "pyproject.toml",
    "estimator.py.txt": "{name}.py",
    "test_estimator.py.txt": "test_{name}.py",
}


@click.command()
@click.argument("name")
def new(name: str) -> None:
    """Write a folder NAME with a plugin: its pyproject.toml, the estimator and a test."""
    if not name.isidentifier() or not name.islower() or keyword.iskeyword(name):
        raise UserError(
            f"cannot call an estimator {name!r}: use lower-case letters, digits and underscores, "
            "such as my_estimator"
        )
    if name in estimator_names():
        raise UserError(f"there is an estimator {name!r} already; choose another name")
    folder = Path(name)
    if folder.exists():
        raise UserError(f"{folder} exists already; choose another name or folder")
    class_name = "".join(part.capitalize() for part in name.split("_"))
    try:
        folder.mkdir()
        for template, target in _FILES.items():
            text = files("bench").joinpath("templates", template).read_text(encoding="utf-8")
            text = Template(text).substitute(name=name, class_name=class_name)
            (folder / target.format(name=name)).write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write to {folder}: {error.strerror or error}") from error
    reference = f"{folder / name}.py:{class_name}"
    click.echo(f"{folder}: {', '.join(target.format(name=name) for target in _FILES.values())}")
    click.echo(f"check it:    olne-bench check {reference}")
    click.echo(f"compare it:  olne-bench run quick --plugin {reference} --out runs/{name}")
    click.echo(f"install it:  pip install -e {folder}   (it is then called {name} everywhere)")

"""``olne-bench new``: the folder of an estimator that works, to start from."""

import keyword
import re
import sys
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from string import Template

import click

from olne_bench.errors import UserError
from olne_bench.estimators.registry import estimator_names

#: Modules of Python that not every system has, or that it hides.
_PYTHON = sys.stdlib_module_names | {"test"}
_TEMPLATES = Path(__file__).parent / "templates"
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
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise UserError(
            f"cannot call an estimator {name!r}: use lower-case letters a to z, digits and "
            "underscores, such as my_estimator"
        )
    if name in estimator_names():
        raise UserError(f"there is an estimator {name!r} already; choose another name")
    folder = Path(name)
    if folder.exists():
        raise UserError(f"{folder} exists already; choose another name or folder")
    if _is_taken(name):
        raise UserError(
            f"cannot call an estimator {name!r}: there is a package or module of this name, which "
            "it would hide; choose another name, such as my_estimator"
        )
    class_name = "".join(part.capitalize() for part in name.split("_"))
    try:
        folder.mkdir()
        for template, target in _FILES.items():
            text = (_TEMPLATES / template).read_text(encoding="utf-8")
            text = Template(text).substitute(name=name, class_name=class_name)
            (folder / target.format(name=name)).write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write to {folder}: {error.strerror or error}") from error
    reference = f"{folder / name}.py:{class_name}"
    click.echo(f"{folder}: {', '.join(target.format(name=name) for target in _FILES.values())}")
    click.echo(f"check it:    olne-bench check {reference}")
    click.echo(f"compare it:  olne-bench run quick --plugin {reference} --out runs/{name}")
    click.echo(f"install it:  pip install -e {folder}   (it is then called {name} everywhere)")


def _is_taken(name: str) -> bool:
    """Whether Python, this project or something installed has a module or package of the name."""
    if name in _PYTHON or find_spec(name) is not None:
        return True
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True

"""``olne-bench new``: create a working plugin to start from."""

import keyword
import re
import sys
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from string import Template

import click

from olne_bench.errors import UserError
from olne_bench.plugins import KINDS, Kind, names

#: Python's modules, with those that only other systems have; "test" is not in Python's own list.
_PYTHON = sys.stdlib_module_names | {"test"}
_TEMPLATES = Path(__file__).parent / "templates"
#: Template and the file that it becomes.
_FILES = {
    "pyproject.toml.txt": "pyproject.toml",
    "{kind}.py.txt": "{name}.py",
    "test_plugin.py.txt": "test_{name}.py",
}
_LIBRARIES = ("casadi", "numpy", "scipy")


def new(kind: str, name: str) -> None:
    """Create a folder NAME with a working plugin of this KIND, its pyproject.toml and a test."""
    chosen = next(one for one in KINDS if one.name == kind)
    _check(chosen, name)
    folder = Path(name)
    class_name = "".join(part.capitalize() for part in name.split("_"))
    targets = {
        template.format(kind=kind): target.format(name=name) for template, target in _FILES.items()
    }
    values = {"kind": kind, "name": name, "class_name": class_name, "group": chosen.group}
    values["article"] = _with_article(kind).capitalize()
    values["dependencies"] = ", ".join(f'"{library}"' for library in _dependencies(kind))
    try:
        folder.mkdir()
        for template, target in targets.items():
            text = Template(_template(template)).substitute(values)
            (folder / target).write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write to {folder}: {error.strerror or error}") from error
    reference = f"{folder / name}.py:{class_name}"
    click.echo(f"{folder}: {', '.join(targets.values())}")
    click.echo(f"check it:    olne-bench check {reference}")
    click.echo(f"compare it:  olne-bench run quick --plugin {reference} --out runs/{name}")
    click.echo(f"install it:  pip install -e {folder}   (it is then called {name} everywhere)")


def _check(kind: Kind, name: str) -> None:
    what = _with_article(kind.name)
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name) or len(name) > 50:
        raise UserError(
            f"cannot call {what} {name[:50]!r}: use lower-case letters a to z, digits and "
            f"underscores, 50 at most, such as my_{kind.name}"
        )
    if name in names(kind):
        raise UserError(f"there is {what} {name!r} already; choose another name")
    if Path(name).exists():
        raise UserError(f"{name} exists already; choose another name or folder")
    if _is_taken(name):
        raise UserError(
            f"cannot call {what} {name!r}: there is a package or module of this name, which "
            f"it would hide; choose another name, such as my_{kind.name}"
        )


def _with_article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


def _dependencies(kind: str) -> list[str]:
    text = _template(f"{kind}.py.txt")
    used = [one for one in _LIBRARIES if re.search(rf"^(import|from) {one}\b", text, re.MULTILINE)]
    return sorted([*used, "olne-bench"])


def _template(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def _is_taken(name: str) -> bool:
    """Whether Python, this project or something installed has a module or package of the name."""
    if name in _PYTHON or find_spec(name) is not None:
        return True
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True

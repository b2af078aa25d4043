"""``import olne_bench`` is quick, and offers what its type stub says."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import olne_bench as ob

SLOW = "{'numpy', 'pandas', 'casadi', 'scipy', 'matplotlib', 'gymnasium', 'highway_env', 'click'}"
PACKAGE = Path(ob.__file__).parent


def in_a_new_process(code):
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return said.stdout.split()


def test_import_loads_no_library():
    code = f"import sys, olne_bench; dir(olne_bench); print(*sorted({SLOW} & set(sys.modules)))"
    assert in_a_new_process(code) == []


def test_import_loads_few_modules():
    code = (
        "import sys; before = set(sys.modules); import olne_bench\n"
        "print(*(name for name in set(sys.modules) - before if name.startswith('olne_bench')))"
    )
    assert in_a_new_process(code) == ["olne_bench"]


def test_tables_of_estimators_survive_the_import_of_their_package():
    code = (
        "import olne_bench.estimators.protocol as p, olne_bench as ob; print(len(ob.estimators()))"
    )
    assert int(in_a_new_process(code)[0]) > 10


def test_the_stub_has_the_same_names():
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text())
    named = {
        (alias.asname or alias.name)
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    } | {"__version__"}
    assert named == set(ob.__all__)
    (listed,) = [node.value for node in stub.body if isinstance(node, ast.Assign)]
    assert ast.literal_eval(listed) == sorted(ob.__all__)


@pytest.mark.parametrize("name", sorted(ob.__all__))
def test_every_name_is_there_and_says_what_it_is(name):
    found = getattr(ob, name)
    assert name in dir(ob)
    if name != "__version__":
        assert inspect.getdoc(found)


def test_other_names_are_refused():
    with pytest.raises(AttributeError, match="no attribute 'solve'"):
        ob.solve  # noqa: B018

"""The registry: what it lists, finds and constructs, and its one-line errors."""

import importlib
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from olne_bench import plugin_places, plugins
from olne_bench.plugins import (
    ESTIMATOR,
    KINDS,
    METRIC,
    SCENARIO,
    SENSOR,
    PluginError,
    at_home,
    describe,
    find_class,
    kind_of,
    label,
    make,
    names,
    source,
)

METHODS = {"estimator": "estimate", "scenario": "draw", "sensor": "layers", "metric": "score"}


def write(folder: Path, name: str, text: str) -> str:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(textwrap.dedent(text))
    return str(path)


def tiny(kind=ESTIMATOR, name="tiny", body="pass", before="", head="class Tiny:"):
    return f"{before}\n{head}\n    name = {name!r}\n    def {kind.method}(self, *a): {body}\n"


def line_of(call, *arguments) -> str:
    with pytest.raises(PluginError) as caught:
        call(*arguments)
    message = str(caught.value)
    assert "\n" not in message
    assert message.isprintable()
    assert len(message) <= 1000
    return message


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_class_of_a_kind_in_its_folder_has_the_name_of_its_file(kind):
    """Names are read from source text, and must be the same as those of imported classes."""
    folder = Path(plugins.__file__).parent.joinpath(*kind.package.split(".")[1:])
    found = set()
    for path in folder.glob("*.py"):
        module = importlib.import_module(f"{kind.package}.{path.stem}")
        for member in vars(module).values():
            own = isinstance(member, type) and member.__module__ == module.__name__
            if own and hasattr(member, "name") and callable(getattr(member, kind.method, None)):
                assert member.name == path.stem
                found.add(path.stem)
    assert names(kind) == sorted(found)
    for name in found:
        module, path = source(kind, name)
        assert sys.modules[module].__file__ == str(path)
        assert find_class(kind, name).__module__ == module
        assert label(kind, name) == name


def test_listing_names_imports_nothing_that_is_slow():
    code = """
        import sys
        from olne_bench import plugin_places, plugins
        for kind in plugins.KINDS:
            for name in plugins.names(kind):
                plugins.source(kind, name)
                assert plugins.is_built_in(kind, name)
        print([name for name in ("casadi", "numpy", "pandas") if name in sys.modules])
    """
    run = [sys.executable, "-c", textwrap.dedent(code)]
    assert subprocess.run(run, capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_file_is_a_plugin_of_any_kind(kind, tmp_path):
    path = write(tmp_path, "tiny.py", tiny(kind))
    assert kind_of(path) == kind_of(f"{path}:Tiny") == kind
    assert find_class(kind, path) is find_class(kind, f"{path}:Tiny")
    assert label(kind, path) == "tiny"
    assert not plugins.is_built_in(kind, path)
    assert type(make(kind, path)).__name__ == "Tiny"
    module, file = source(kind, path)
    assert file == Path(path) and sys.modules[module].__file__ == path
    assert describe(None, path).kind == kind.name


def test_references_are_made_absolute(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert plugins.absolute("a.py:B") == f"{tmp_path / 'a.py'}:B"
    assert plugins.absolute("a.py") == str(tmp_path / "a.py")
    assert plugins.absolute("uniform") == "uniform"
    assert plugins.is_file("x:y/a.py") and plugins.is_file("x:y/a.py:B")
    assert not plugins.is_file("a.py.b")


BAD_FILES = {
    "no name": ("class A:\n    def estimate(self): pass", "has no name: give its class"),
    "empty": (tiny(name=" "), "has ' ' for a name: it has to be a text that is not empty"),
    "a number": (tiny(name=3), "has a int for a name"),
    "two lines": (tiny(name="a\nb"), r"has the name 'a\nb': it has to be at most 100 printable"),
    "escape": (tiny(name="a\x1b[2J"), r"has the name 'a\x1b[2J'"),
    "long": (tiny(name="a" * 101), "it has to be at most 100 printable characters"),
    "raises": ("x = 1\nraise RuntimeError('no\\nlicence')", "RuntimeError: no licence ("),
    "exits": ("import sys\nsys.exit('bye')", "SystemExit: bye ("),
    "interrupts": ("raise KeyboardInterrupt", "KeyboardInterrupt: ("),
    "base": ("class E(BaseException): pass\nraise E('gone')", "E: gone ("),
    "generator": ("raise GeneratorExit", "GeneratorExit: ("),
    "ours": (
        "from olne_bench.plugins import PluginError\nraise PluginError('x')",
        "PluginError: x",
    ),
    "mute": (
        "class E(Exception):\n    def __str__(self): raise KeyboardInterrupt\nraise E",
        "E: no text (",
    ),
    "long message": ("raise ValueError('x' * 10**7)", "ValueError: xxx"),
    "syntax": ("class A(\n", "SyntaxError: '(' was never closed ("),
    "nul": ("x = 0\0", "null bytes ("),
    "place in Python's importer": ("import importlib\nimportlib.import_module('')", "plugin.py)"),
    "no class": ("x = 1", "must define one estimator or be named as"),
    "another kind": (tiny(SENSOR), "it has: none with a method 'estimate'"),
    "several": (tiny() + tiny(head="class Other:"), "it has: Tiny, Other"),
    "metaclass": (
        tiny(
            before="class M(type):\n    def __getattribute__(cls, name): raise KeyError(name)",
            head="class A(metaclass=M):",
        ),
        ": 'estimate' cannot be read: KeyError: 'estimate' (",
    ),
    "property": (
        "class M(type):\n    @property\n    def name(cls): raise SystemExit('hidden')\n"
        "class A(metaclass=M):\n    def estimate(self): pass",
        ": 'name' cannot be read: SystemExit: hidden (",
    ),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_a_bad_file_is_one_line(case, tmp_path):
    text, expected = BAD_FILES[case]
    path = tmp_path / "plugin.py"
    path.write_text(text)
    assert expected in line_of(find_class, ESTIMATOR, str(path))
    assert expected in line_of(make, ESTIMATOR, str(path))
    assert expected in describe(ESTIMATOR, str(path)).error
    source(ESTIMATOR, str(path))  # without importing the file


@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        ("nope", "unknown estimator 'nope'; known are: behaving, bilevel, "),
        ("nope.py", "no estimator file 'nope.py'"),
        ("nope.py:A", "no estimator file 'nope.py'"),
        ("a\0.py", "no estimator file"),
        ("a" * 300 + ".py", "no estimator file"),
        ("a" * 3000, "unknown estimator 'aaa"),
        (["a"], "unknown estimator ['a']"),
        (".py", "no estimator file"),
    ],
)
def test_an_unknown_reference_is_one_line(reference, expected):
    for call in (find_class, make, source):
        assert expected in line_of(call, ESTIMATOR, reference)


def test_a_class_that_is_not_there_is_named_with_those_that_are(tmp_path):
    path = write(tmp_path, "plugin.py", tiny())
    assert "has no estimator 'Other'; it has: Tiny" in line_of(
        find_class, ESTIMATOR, f"{path}:Other"
    )


def test_helper_classes_without_a_name_are_no_plugins(tmp_path):
    helper = "class Sampler:\n    def estimate(self): pass\n    def draw(self): pass\n"
    path = write(tmp_path, "plugin.py", helper + tiny())
    assert label(ESTIMATOR, path) == "tiny"


def test_the_kind_of_a_file_is_one(tmp_path):
    both = write(tmp_path, "both.py", tiny(METRIC) + tiny(SENSOR, head="class Other:"))
    assert "holds several plugins" in line_of(kind_of, both)
    assert "Other (sensor), Tiny (metric)" in line_of(kind_of, both)
    assert kind_of(f"{both}:Other") == SENSOR
    one = write(tmp_path, "one.py", tiny(METRIC) + "    def layers(self): pass\n")
    assert "with one method of" in line_of(kind_of, one)
    none = write(tmp_path, "none.py", "class A: pass")
    assert "is not a plugin: expected a class with one method of estimate" in line_of(kind_of, none)
    assert "'A' in" in line_of(kind_of, f"{none}:A")
    assert "is not a plugin file" in line_of(kind_of, "uniform")
    assert describe(None, none).error.endswith("score (metric)")


REFUSES = """
    class Picky:
        name = "picky"
        def __init__(self, size=1, other=2):
            if size == "type": raise TypeError("of text")
            if size == "value": raise ValueError("too\\nlarge")
            if size == "key": raise KeyError("lost")
            if size == "exit": raise SystemExit
        def estimate(self): pass
"""


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"size": "type"}, "refuses its parameters: of text; its parameters: size, other"),
        ({"size": "value"}, "refuses its parameters: too large; its parameters: size, other"),
        ({"count": 1}, "unexpected keyword argument 'count'; its parameters: size, other"),
        ({"size": "key"}, "cannot be made: KeyError: 'lost' ("),
        ({"size": "exit"}, "cannot be made: SystemExit: ("),
    ],
)
def test_refused_parameters_are_one_line(tmp_path, parameters, expected):
    path = write(tmp_path, "picky.py", REFUSES)
    assert expected in line_of(make, ESTIMATOR, path, parameters)
    assert expected in describe(ESTIMATOR, path, parameters).error
    assert describe(ESTIMATOR, path).parameters == ("size", "other")


def test_a_description_is_plain_data(tmp_path):
    metric = """
        class Wide:
            name, label, unit, worst = "wide", "width", "m", 3.0
            needs_prediction = gated = True
            def __init__(self, level=1): self.compared = level > 1
            def score(self, case): return 0.0
    """
    path = write(tmp_path, "wide.py", metric)
    found = describe(None, path, {"level": 2})
    assert found == plugins.Description(
        kind="metric",
        reference=path,
        label="wide",
        parameters=("level",),
        declaration={
            "label": "width",
            "unit": "m",
            "worst": 3.0,
            "needs_prediction": True,
            "gated": True,
            "compared": True,
            "description": "",
        },
    )
    path = write(tmp_path, "lists.py", tiny(METRIC) + "    unit = ['m']\n")
    assert "declares 'unit' as a list" in describe(METRIC, path).error
    path = write(tmp_path, "lines.py", tiny(METRIC) + "    label = 'a\\nb'\n")
    assert "declares 'label' as 'a\\nb'" in describe(METRIC, path).error
    assert describe(SCENARIO, "random").family
    assert not describe(SCENARIO, "two_player").family
    assert describe(ESTIMATOR, "uniform").several
    assert not describe(ESTIMATOR, write(tmp_path, "one.py", tiny())).several


# Helper modules beside a file.

WITH_HELPER = """
    import helper
    class Helped:
        name = "helped"
        eager = helper.VALUE
        def estimate(self):
            import late, lib.part
            return helper.VALUE, late.VALUE, lib.part.VALUE
"""


def plugin_with_helpers(folder: Path, value: str) -> str:
    write(folder, "helper.py", f"VALUE = 'eager {value}'")
    write(folder, "late.py", f"import helper\nVALUE = 'late {value} ' + helper.VALUE")
    write(folder, "lib/part.py", f"VALUE = 'part {value}'")
    return write(folder, "plugin.py", WITH_HELPER)


def test_two_plugins_with_helpers_of_one_name_each_get_their_own(tmp_path):
    before, path = set(sys.modules), list(sys.path)
    made = {value: make(ESTIMATOR, plugin_with_helpers(tmp_path / value, value)) for value in "ab"}
    for _ in range(2):
        for value, plugin in made.items():
            assert plugin.eager == f"eager {value}"
            with at_home(plugin):
                assert plugin.estimate() == (
                    f"eager {value}",
                    f"late {value} eager {value}",
                    f"part {value}",
                )
            with at_home(type(plugin)), at_home(plugin):
                import helper  # type: ignore[import-not-found]

                assert f"eager {value}" == helper.VALUE
    new = {name for name in set(sys.modules) - before if not name.startswith("olne_bench")}
    assert new == set()
    assert sys.path == path
    with pytest.raises(ImportError):
        importlib.import_module("late")


def test_helpers_are_the_same_modules_at_every_visit(tmp_path):
    plugin = make(ESTIMATOR, plugin_with_helpers(tmp_path, "a"))
    seen = []
    for _ in range(2):
        with at_home(plugin):
            seen.append(importlib.import_module("late"))
    assert seen[0] is seen[1]


def test_a_folder_shadows_neither_python_nor_what_is_installed(tmp_path):
    for name in ("colorsys", "scipy", "pydantic", "json", "olne_bench"):
        write(tmp_path, f"{name}.py", "raise RuntimeError('shadowed')")
    path = write(tmp_path, "plugin.py", tiny(before="import colorsys, scipy, json, olne_bench"))
    sys.modules.pop("colorsys", None)
    with at_home(find_class(ESTIMATOR, path)):
        importlib.import_module("pydantic")
    assert str(tmp_path) not in str(importlib.import_module("colorsys").__file__)


def test_what_a_plugin_puts_on_the_path_is_there_for_it_alone(tmp_path):
    write(tmp_path, "elsewhere/of_its_own.py", "VALUE = 1")
    head = f"import sys\nsys.path.insert(0, {str(tmp_path / 'elsewhere')!r})"
    path = write(tmp_path, "a/plugin.py", tiny(before=head, body="import of_its_own"))
    before = list(sys.path)
    plugin = make(ESTIMATOR, path)
    assert sys.path == before
    with at_home(plugin):
        plugin.estimate()
    assert sys.path == before
    sys.modules.pop("of_its_own")


def test_a_helper_that_a_caller_has_imported_comes_back(tmp_path, monkeypatch):
    path = plugin_with_helpers(tmp_path / "a", "a")
    write(tmp_path / "caller", "helper.py", "VALUE = 'of the caller'")
    monkeypatch.syspath_prepend(str(tmp_path / "caller"))
    ours = importlib.import_module("helper")
    monkeypatch.setitem(sys.modules, "helper", ours)
    plugin = make(ESTIMATOR, path)
    assert plugin.eager == "eager a"
    assert sys.modules["helper"] is ours


def test_a_file_that_fails_leaves_nothing(tmp_path):
    write(tmp_path, "helper.py", "VALUE = 1")
    path = write(tmp_path, "plugin.py", "import helper\nraise RuntimeError")
    before = set(sys.modules)
    line_of(find_class, ESTIMATOR, path)
    assert set(sys.modules) == before


# Entry points.

MARK = "import pathlib; pathlib.Path(__file__).with_suffix('.imported').touch()\n"


@pytest.fixture
def site(tmp_path, monkeypatch):
    """A folder of installed packages; returns a function that installs one."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))

    def install(project: str, entries: str, **files: str) -> Path:
        info = folder / f"{project}-1.0.dist-info"
        write(info, "METADATA", f"Metadata-Version: 2.1\nName: {project}\nVersion: 1.0\n")
        write(info, "entry_points.txt", entries)
        for name, text in files.items():
            write(folder, name.replace("__", "/") + ".py", MARK + text)
        importlib.invalidate_caches()
        plugin_places.listed_points.cache_clear()
        plugins._known_class.cache_clear()
        return folder

    yield install
    plugin_places.listed_points.cache_clear()
    plugins._known_class.cache_clear()
    for name in [n for n in sys.modules if n.partition(".")[0].startswith("foreign")]:
        del sys.modules[name]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_an_installed_plugin_is_listed_and_located_without_being_imported(kind, site):
    text = tiny(kind, "foreign_one")
    folder = site("p", f"[{kind.group}]\nforeign_one = foreign.deep.part:Tiny\n")
    for name in ("foreign/__init__", "foreign/deep/__init__", "foreign/deep/part"):
        write(folder, f"{name}.py", MARK + (text if name.endswith("part") else ""))
    assert "foreign_one" in names(kind)
    assert not plugins.is_built_in(kind, "foreign_one")
    assert source(kind, "foreign_one") == (
        "foreign.deep.part",
        (folder / "foreign/deep/part.py").resolve(),
    )
    assert not list(folder.rglob("*.imported")), "nothing was imported"
    assert label(kind, "foreign_one") == "foreign_one"
    assert type(make(kind, "foreign_one")).__module__ == "foreign.deep.part"
    assert len(list(folder.rglob("*.imported"))) == 3


def test_a_package_without_init_is_located_too(site):
    folder = site(
        "p", f"[{METRIC.group}]\nfar = foreign.deep.part:Tiny\n", foreign__deep__part=tiny(METRIC)
    )
    assert source(METRIC, "far")[1] == (folder / "foreign/deep/part.py").resolve()


@pytest.mark.parametrize(
    ("value", "text", "expected"),
    [
        ("foreign_m:Tiny", tiny(name="other"), "installed under another name than its class has"),
        ("foreign_m:Tiny", "raise SystemExit('no')", "cannot be imported: SystemExit: no ("),
        ("foreign_m:Tiny", "class Tiny: name = 'mine'", "has no method 'estimate'"),
        ("foreign_m:Tiny", "Tiny = 3", "is not a class"),
        ("foreign_m:Tiny", "", "cannot be imported: AttributeError"),
        ("foreign_m:Tiny", "class Tiny:\n    def estimate(self): 0", "has no name"),
        ("foreign_absent:Tiny", "", "cannot be imported: ModuleNotFoundError"),
        ("3 + 4", "", "cannot be imported"),
    ],
)
def test_a_bad_installed_plugin_is_one_line(value, text, expected, site):
    site("the-project", f"[{ESTIMATOR.group}]\nmine = {value}\n", foreign_m=text)
    line = line_of(find_class, ESTIMATOR, "mine")
    assert expected in line
    assert "of the-project" in line


def test_an_absent_module_has_no_source(site):
    site("p", f"[{ESTIMATOR.group}]\na = foreign_absent.x:T\nb = 3 + 4\nc = sys:T\n")
    assert "no module 'foreign_absent'" in line_of(source, ESTIMATOR, "a")
    assert "estimator 'b' of p" in line_of(source, ESTIMATOR, "b")
    assert "has no file" in line_of(source, ESTIMATOR, "c")


def test_two_plugins_of_one_name_are_one_line(site):
    site("p", f"[{ESTIMATOR.group}]\nuniform = foreign_a:Tiny\nx = foreign_a:Tiny\n")
    site("q", f"[{ESTIMATOR.group}]\nx = foreign_b:Tiny\n")
    line = line_of(find_class, ESTIMATOR, "uniform")
    assert "two" not in line and "2 estimators called 'uniform': the built-in one, of p" in line
    assert "2 estimators called 'x': of " in line_of(source, ESTIMATOR, "x")
    assert names(ESTIMATOR).count("uniform") == 1
    assert make(ESTIMATOR, "kkt_residual") is not None

import xml.etree.ElementTree as ET
from pathlib import Path

import matplotlib.image
import pandas as pd
import pytest

from olne_bench.bench.report.figures import draw_figures, over_noise, style
from olne_bench.bench.report.formats import FORMATS
from olne_bench.bench.report.tables import tabulate

#: Those that all figures are tried in take their time.
ONE_FORMAT = ("png",)
KINDS = ("errors", "failures", "trial", "identifiability")
#: Those of trials without noise, of one estimator, or with a sensor that is not known here.
FEWER = ("errors", "failures")


@pytest.fixture
def drawn(usual):
    def draw(trials: pd.DataFrame, folder: Path, formats=ONE_FORMAT) -> list[Path]:
        draw_figures(trials, tabulate(trials, usual), folder, formats, usual)
        return sorted(folder.iterdir()) if folder.exists() else []

    return draw


def names(files: list[Path]) -> set[str]:
    return {file.name for file in files}


def expected(
    scenario: str, kinds: tuple[str, ...] = KINDS, formats: tuple[str, ...] = ONE_FORMAT
) -> set[str]:
    """Names of the files of a scenario."""
    return {f"{kind}_{scenario}.{ending}" for kind in kinds for ending in formats}


def scores(formats: tuple[str, ...] = ONE_FORMAT) -> set[str]:
    return {f"scores.{ending}" for ending in formats}


def assert_drawn(files: list[Path]) -> None:
    """Check that every file exists, is well formed, and shows something."""
    for file in files:
        assert file.exists()
        if file.suffix == ".svg":
            assert ET.parse(file).getroot().tag.endswith("svg")
        elif file.suffix == ".pdf":
            assert file.read_bytes().startswith(b"%PDF-")
            assert file.stat().st_size > 5000
        else:
            pixels = matplotlib.image.imread(file)[..., :3]
            inked = (pixels < 0.9).any(axis=-1).mean()
            assert inked > 0.01, f"{file.name} is blank"


@pytest.mark.parametrize(
    ("formats", "part"),
    [
        (ONE_FORMAT, {"sensors": ("full",), "seeds": 1}),
        pytest.param(FORMATS, {}, marks=pytest.mark.long),
    ],
    ids=["one format", "all"],
)
def test_a_study_gives_every_figure_small_and_not_blank(
    drawn, make_trials, tmp_path, formats, part
):
    files = drawn(make_trials(**part), tmp_path / "new" / "folder", formats)
    assert names(files) == expected("two_player", formats=formats) | scores(formats)
    assert_drawn(files)
    assert max(file.stat().st_size for file in files) < 300_000


@pytest.mark.long
def test_reruns_give_identical_files(drawn, make_trials, tmp_path):
    trials = make_trials(estimators=("kkt_residual",), seeds=1, sigmas=(0.0, 0.1))
    first, second = (drawn(trials, tmp_path / run, FORMATS) for run in ("a", "b"))
    for a, b in zip(first, second, strict=True):
        assert a.read_bytes() == b.read_bytes(), a.name
        assert b"<dc:date>" not in a.read_bytes()


@pytest.mark.long
def test_the_users_own_settings_do_not_matter(drawn, make_trials, tmp_path):
    trials = make_trials(estimators=("a",), sensors=("full",), seeds=1, sigmas=(0.1,))
    plain = drawn(trials, tmp_path / "a")
    with matplotlib.rc_context({"lines.linewidth": 9, "axes.facecolor": "red", "font.size": 30}):
        changed = drawn(trials, tmp_path / "b")
        assert matplotlib.rcParams["lines.linewidth"] == 9
    for a, b in zip(plain, changed, strict=True):
        assert a.read_bytes() == b.read_bytes(), a.name


@pytest.mark.parametrize(
    ("part", "kinds"),
    [
        ({"estimators": ("uniform",), "seeds": 1}, (*FEWER, "identifiability")),
        ({"estimators": ("unknown_method",), "sensors": ("partial",), "sigmas": (0.0,)}, FEWER),
        ({"sensors": ("bearing_only",), "sigmas": (0.05,)}, (*FEWER, "trial", "scores")),
        ({"status": "failed_forward", "sensors": ("full",)}, (*FEWER, "identifiability", "scores")),
        ({"status": "not_converged", "sensors": ("full",)}, (*FEWER, "identifiability")),
    ],
    ids=["floor only", "no noise", "unknown sensor", "no prediction", "failures only"],
)
def test_any_part_of_a_study_will_do(drawn, make_trials, tmp_path, part, kinds):
    files = drawn(make_trials(**part), tmp_path)
    assert {name.partition("_")[0].partition(".")[0] for name in names(files)} == {*kinds}
    assert_drawn(files)


def test_single_failure(drawn, make_trials, tmp_path):
    trials = make_trials(status="crash", sigmas=(0.1,), seeds=1).head(1)
    assert_drawn(drawn(trials, tmp_path))


def test_nothing_attempted_gives_no_figure(drawn, make_trials, tmp_path):
    trials = make_trials(status="skipped")
    assert drawn(trials, tmp_path) == []
    assert drawn(trials.head(0), tmp_path) == []


def test_a_scenario_unknown_here_still_has_statistics(drawn, make_trials, tmp_path):
    trials = make_trials(sensors=("full",), seeds=1).assign(scenario="of_another_version")
    files = drawn(trials, tmp_path)
    assert names(files) == expected("of_another_version", FEWER) | scores()


def test_each_scenario_on_its_own(drawn, make_trials, tmp_path):
    two = ("kkt_residual", "kkt_constrained")
    highway = make_trials("highway_overtaking", two, ("full",), (0.1,), 1)
    family = make_trials("random", two, ("full",), (0.1,), 3)
    files = drawn(pd.concat([highway, family], ignore_index=True), tmp_path)
    assert names(files) == expected("highway_overtaking") | expected("random") | scores()
    assert_drawn(files)


ODD_NAMES = (
    r"$\alpha$",
    r"$\undefined{",
    "<script>alert('x')</script> & --> ]]>",
    "_private",
    "名前 é 🚗",
    "two\nlines\tand\x00\x1b[31m",
    "",
    "x" * 500,
    "100% {} %s",
)


def test_names_of_estimators_are_text_and_nothing_else(drawn, make_trials, tmp_path):
    files = drawn(make_trials("two_player", ODD_NAMES, ("full",), (0.1,), 1), tmp_path, ("svg",))
    assert names(files) == expected("two_player", formats=("svg",)) | scores(("svg",))
    assert_drawn(files)
    for file in files:
        tags = {element.tag.rpartition("}")[2] for element in ET.parse(file).iter()}
        assert "script" not in tags


def test_names_are_shown_as_they_are(make_trials):
    with style.applied():
        trials = make_trials(estimators=ODD_NAMES, sensors=("full",), sigmas=(0.1,), seeds=1)
        figure = over_noise.draw_errors(trials)
    texts = figure.legends[0].get_texts()
    assert {text.get_text() for text in texts} == {style.printable(name) for name in ODD_NAMES}
    assert not any(text.get_parse_math() for text in texts)

"""Style of all figures: colours, text, legends, and how a figure is saved."""

import io
import math
import re
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from matplotlib.typing import LineStyleType

from olne_bench.bench.report.formats import USUAL_FORMATS
from olne_bench.bench.report.statistics.attempts import FLOOR

#: One (strong, light) pair per built-in estimator, for the paper's two sensors: shades of one hue
#: of Okabe and Ito, which colour-blind readers can distinguish. A name keeps its pair in every
#: study. No player has one of these colours (``envs.worlds.scene.PLAYER_COLOURS``). ``ignorant``
#: stands for several estimators, so that its labels decide.
ESTIMATOR_COLOURS = {
    "kkt_constrained": ("#0072B2", "#56B4E9"),
    "kkt_residual": ("#D55E00", "#E69F00"),
    "bilevel": ("#007A59", "#4FC9A4"),
    "posterior": ("#463983", "#C6BFDE"),
    "map": ("#1B6F77", "#8DBBBF"),
    "maxent_residual": ("#9E3D75", "#DD9BC2"),
    "particle": ("#7A6A00", "#CFC22B"),
    "ukf": ("#3B2A1A", "#A98F76"),
    "ridge": ("#5C5C3D", "#B3B39C"),
    "neural_posterior": ("#A3007D", "#F2A6DD"),
}
#: Pairs of all other estimators, chosen by name.
FOREIGN_COLOURS = (
    ("#7B242E", "#C48E94"),
    ("#215605", "#8FB07E"),
    ("#73176F", "#BE86BB"),
    ("#9B5F55", "#D2B3AD"),
    ("#46606E", "#A3B4BD"),
    ("#3D5A00", "#A9B96E"),
    ("#8A4B08", "#CFA574"),
    ("#5A2A5A", "#B592B5"),
)

_PAPER_SENSORS = ("full", "partial")

FLOOR_COLOUR = "#8C8C8C"

LINE_STYLES: tuple[LineStyleType, ...] = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)))
#: Markers of plugins, and of built-in estimators. A triangle that points up is a failure.
MARKERS = ("o", "s", "D", "v", "P", "X")
_OWN_MARKERS = (*MARKERS, "p", "h", "d", "8")

_DPI = 130
_SAVING: dict[str, dict[str, Any]] = {
    # Points and ribbons are rasterised at this resolution, which keeps files small.
    "png": {},
    "svg": {"metadata": {"Date": None}, "dpi": 100},
    "pdf": {"metadata": {"CreationDate": None}, "dpi": 200},
}
#: Ids that Matplotlib counts, which several figures on a page would share, and metadata.
_UNWANTED = re.compile(r' id="[A-Za-z0-9]+_\d+"|<metadata>.*?</metadata>', re.DOTALL)
_LONGEST_NAME = 32  # characters
_MOST_COLUMNS = 6  # of a legend
_ENTRY_WIDTH, _ENTRY_HEIGHT, _CHARACTER_WIDTH = 0.55, 0.19, 0.077  # [inch] in a legend
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_RC = {
    "axes.grid": True,
    "axes.labelsize": 9,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 9,
    "figure.constrained_layout.use": True,
    "figure.dpi": _DPI,
    "figure.titlesize": 10.5,
    "font.size": 9,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "path.simplify_threshold": 0.4,
    "pdf.fonttype": 42,  # fonts that publishers accept
    "svg.fonttype": "path",
    "svg.hashsalt": "olne-bench",  # element ids that do not change from run to run
    "text.parse_math": False,  # names come from authors: a dollar is a dollar
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
}


@contextmanager
def applied() -> Iterator[None]:
    """Use the project's settings instead of the user's."""
    with matplotlib.style.context(["default", _RC]), warnings.catch_warnings():
        # A name may hold characters that the font lacks; a box in their place is fine.
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from", category=UserWarning)
        yield


def save(figure: Figure, stem: Path, formats: Sequence[str] = USUAL_FORMATS) -> list[Path]:
    """Write ``<stem>.png`` and so on, without a date, and return their paths."""
    _lay_out(figure)
    paths = []
    for name in formats:
        path = stem.with_name(f"{stem.name}.{name}")
        figure.savefig(path, **_SAVING[name])
        paths.append(path)
    return paths


def svg_text(figure: Figure) -> str:
    """A figure as an SVG element for a page, whose text stays text."""
    _lay_out(figure)
    whole = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(whole, format="svg", **_SAVING["svg"])
    svg = whole.getvalue()
    return _UNWANTED.sub("", svg[svg.index("<svg") :])


def _lay_out(figure: Figure) -> None:
    """Compute the layout once, not for each file."""
    equal = any(axes.get_aspect() != "auto" for axes in figure.axes)
    for _ in range(2 if equal else 1):  # panels of equal aspect settle in the second round
        figure.draw_without_rendering()
    figure.set_layout_engine("none")


def file_name(label: str) -> str:
    """A label as part of a file name that any system allows."""
    return "".join(c if c.isprintable() and c not in '/\\:*?"<>|' else "_" for c in label)


def printable(name: str) -> str:
    """A name that can be drawn: one line, of bounded length, without what XML forbids."""
    name = "".join(c if c.isprintable() else " " for c in name).strip() or "(no name)"
    return name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}…"


def estimator_order(names: Sequence[str]) -> list[str]:
    """Distinct names, built-in estimators first, the floor last."""
    own = list(ESTIMATOR_COLOURS)
    return sorted(set(names), key=lambda n: (n == FLOOR, own.index(n) if n in own else len(own), n))


def estimator_colours(name: str) -> tuple[str, str]:
    """An estimator's (strong, light) pair, the same in every study."""
    if name == FLOOR:
        return FLOOR_COLOUR, FLOOR_COLOUR
    return ESTIMATOR_COLOURS.get(name) or FOREIGN_COLOURS[_digest(name) % len(FOREIGN_COLOURS)]


def estimator_marker(name: str) -> str:
    """An estimator's marker, the same in every study; it distinguishes two of one colour."""
    own = list(ESTIMATOR_COLOURS)
    if name in own:
        return _OWN_MARKERS[own.index(name)]
    return MARKERS[_digest(name) // len(FOREIGN_COLOURS) % len(MARKERS)]


def _digest(name: str) -> int:
    return zlib.crc32(name.encode(errors="replace"))


def sensor_order(labels: Sequence[str]) -> list[str]:
    """Distinct labels of sensors, the paper's two first."""
    return sorted(set(labels), key=lambda s: (s not in _PAPER_SENSORS, s))


def log_axis(axes: Axes, bottom: float, top: float) -> None:
    """A logarithmic ordinate whose lowest tick also stands for all that is smaller."""
    axes.set_yscale("log")
    axes.set_ylim(bottom, top)
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: _power(y, below=y <= bottom)))


def _power(value: float, below: bool) -> str:
    # Plain characters, as mathematical text is switched off.
    exponent = str(round(math.log10(value))).translate(_SUPERSCRIPTS)
    return f"{'≤ ' if below else ''}10{exponent}"


def legend_below(figure: Figure, entries: Sequence[tuple[Artist, str]]) -> None:
    """A legend under all axes, where it covers no data; the figure grows by its height."""
    width = _ENTRY_WIDTH + _CHARACTER_WIDTH * max(len(name) for _, name in entries)
    columns = max(1, min(_MOST_COLUMNS, int(figure.get_figwidth() / width)))
    rows = math.ceil(len(entries) / columns)
    figure.set_figheight(figure.get_figheight() + _ENTRY_HEIGHT * rows)
    # Matplotlib drops labels with a leading underscore, so the names come in afterwards.
    legend = figure.legend(
        [artist for artist, _ in entries],
        ["name"] * len(entries),
        loc="outside lower center",
        ncols=columns,
    )
    for text, (_, name) in zip(legend.get_texts(), entries, strict=True):
        text.set_text(name)

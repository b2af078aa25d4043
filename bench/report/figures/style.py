"""What figures share: colours, panels, scales, text, legends, and how a figure is saved."""

import io
import math
import re
import textwrap
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.style
import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator, PercentFormatter
from matplotlib.typing import LineStyleType

from olne_bench.bench.report.formats import USUAL_FORMATS
from olne_bench.bench.report.statistics.attempts import FLOOR
from olne_bench.errors import UserError

#: One (strong, light) pair per built-in estimator: shades of one hue of Okabe and Ito, which
#: colour-blind readers can distinguish, and which no player has. ``ignorant`` stands for several
#: estimators, so that its labels decide.
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
    "robust": ("#AA00FF", "#DDB8FF"),
    "imperfect": ("#000099", "#BFC6FF"),
    "behaving": ("#5C0A3A", "#D9A3C4"),
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
_OWN_MARKERS = (*MARKERS, "p", "h", "d", "8", "*", "H", "<")

_SAVING: dict[str, dict[str, Any]] = {
    # Points and ribbons are rasterised at this resolution, which keeps files small.
    "png": {},
    "svg": {"metadata": {"Date": None}, "dpi": 100},
    "pdf": {"metadata": {"CreationDate": None}, "dpi": 200},
}
#: Ids that Matplotlib counts, which several figures on a page would share, and metadata.
_UNWANTED = re.compile(r' id="[A-Za-z0-9]+_\d+"|<metadata>.*?</metadata>', re.DOTALL)
#: Artists and names of a legend.
Entries = Sequence[tuple[Artist, str]]
#: Panels of a figure: more could not be read.
MOST_PANELS = 6

_LONGEST_NAME = 32  # characters
_COLUMNS, _MOST_COLUMNS = 3, 6  # of panels; of a legend
_ENTRY_WIDTH, _ENTRY_HEIGHT, _CHARACTER_WIDTH = 0.55, 0.19, 0.077  # [inch] in a legend
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_RC = Path(__file__).with_name("style.mplstyle")


@contextmanager
def applied() -> Iterator[None]:
    """Use the project's settings instead of the user's."""
    with matplotlib.style.context(["default", _RC]), warnings.catch_warnings():
        # A name may hold characters that the font lacks; a box in their place is fine.
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from", category=UserWarning)
        yield


def save(figure: Figure, stem: Path, formats: Sequence[str] = USUAL_FORMATS) -> list[Path]:
    """Write ``<stem>.png`` and so on, without a date, and return their paths."""
    paths = [stem.with_name(f"{stem.name}.{name}") for name in formats]
    try:
        stem.parent.mkdir(parents=True, exist_ok=True)
        with matplotlib.rc_context({"figure.constrained_layout.use": False}):
            _lay_out(figure)
            for name, path in zip(formats, paths, strict=True):
                figure.savefig(path, **_SAVING[name])
    except OSError as error:
        raise UserError(f"cannot write to {stem.parent}: {error.strerror or error}") from error
    return paths


def svg_text(figure: Figure) -> str:
    """A figure as an SVG element for a page, whose text stays text."""
    whole = io.StringIO()
    with matplotlib.rc_context({"figure.constrained_layout.use": False, "svg.fonttype": "none"}):
        _lay_out(figure)
        figure.savefig(whole, format="svg", **_SAVING["svg"])
    svg = whole.getvalue()
    return _UNWANTED.sub("", svg[svg.index("<svg") :])


def _lay_out(figure: Figure) -> None:
    """Compute the layout once, not for each file, as the settings would."""
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
    figure.set_layout_engine(None)


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
    axes.yaxis.set_minor_locator(NullLocator())

    def power(value: float, _: Any) -> str:  # in plain characters, as mathematical text is off
        exponent = str(round(math.log10(value))).translate(_SUPERSCRIPTS)
        return f"{'≤ ' if value <= bottom else ''}10{exponent}"

    axes.yaxis.set_major_formatter(power)


def plain(value: float, _: Any = None) -> str:
    """A tick without an offset or a power of ten."""
    return f"{value:g}"


def entitle(figure: Figure, title: str, note: str = "") -> None:
    """A title, and a note below the panels, at the left, where a narrow screen begins."""
    most = int(figure.get_figwidth() / _CHARACTER_WIDTH)
    lines = [part for line in title.splitlines() for part in textwrap.wrap(line, most)]
    figure.suptitle("\n".join(lines), x=0.01, horizontalalignment="left")
    if note:
        figure.supxlabel(note, x=0.01, horizontalalignment="left", fontsize=8)


def legend_below(figure: Figure, entries: Entries) -> None:
    """A legend under all axes, where it covers no data; the figure grows by its height."""
    width = _ENTRY_WIDTH + _CHARACTER_WIDTH * max(len(name) for _, name in entries)
    columns = max(1, min(_MOST_COLUMNS, int(figure.get_figwidth() / width)))
    rows = math.ceil(len(entries) / columns)
    figure.set_figheight(figure.get_figheight() + _ENTRY_HEIGHT * rows)
    # Matplotlib drops labels with a leading underscore, so the names come in afterwards.
    legend = figure.legend(
        [artist for artist, _ in entries],
        ["name"] * len(entries),
        loc="outside lower left",
        ncols=columns,
    )
    for text, (_, name) in zip(legend.get_texts(), entries, strict=True):
        text.set_text(name)


def grid(
    titles: Sequence[str], size: tuple[float, float], most: int = MOST_PANELS
) -> tuple[Figure, list[Axes]]:
    """A figure with a panel of a size [inch] for each of the first titles, six or so many."""
    number = min(len(titles), most)
    columns = min(number, 2 if number == 4 else _COLUMNS)
    rows = -(-number // columns)
    figure = Figure(figsize=(max(columns * size[0], 4.8), rows * size[1] + 0.5))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[number:]:
        axes.remove()
    for axes, title in zip(panels, titles, strict=False):
        axes.set_title(printable(title))
    return figure, list(panels[:number])


def by_sensor(
    table: pd.DataFrame, size: tuple[float, float]
) -> tuple[Figure, list[tuple[Axes, pd.DataFrame]]]:
    """A figure with a panel for each of the first six sensors of a table, and their rows."""
    sensors = sensor_order(table["sensor"].tolist())
    figure, panels = grid(sensors, size)
    own = (table[table["sensor"] == sensor] for sensor in sensors)
    return figure, list(zip(panels, own, strict=False))


def levels_axis(axes: Axes, levels: Sequence[float]) -> None:
    """An abscissa of noise levels, evenly spaced."""
    labels = [f"{level:g}" for level in levels]
    axes.set_xticks(range(len(levels)), labels, rotation=60 if len(levels) > 8 else 0)
    axes.set_xlim(-0.5, len(levels) - 0.5)
    axes.set_xlabel("Noise level σ [m]")


def offsets(number: int) -> np.ndarray:
    """Shifts (number,) that keep the intervals of a level apart."""
    return np.linspace(-0.3, 0.3, number) if number > 1 else np.zeros(1)


def with_interval(axes: Axes, x: Any, values: np.ndarray, looks: dict[str, Any]) -> None:
    """A line through points (P,) with bars; ``values`` (3, P) are middle, low and high."""
    middle, low, high = values
    _, top = axes.get_ylim()
    axes.vlines(x, low, np.minimum(high, top), color=looks["color"], alpha=0.55, linewidth=1.6)
    axes.plot(x, np.where(np.isfinite(middle), middle, np.nan), **looks)


def estimator_looks(name: str) -> dict[str, Any]:
    """Colour and marker of an estimator."""
    if name == FLOOR:
        return {"color": FLOOR_COLOUR, "linewidth": 1.0, "marker": ""}
    colour, marker = estimator_colours(name)[0], estimator_marker(name)
    return {"color": colour, "marker": marker, "markersize": 4, "linewidth": 1.1}


def estimator_entries(names: Sequence[str]) -> Entries:
    """Entries of a legend for estimators."""
    return [(Line2D([], [], **estimator_looks(n)), printable(n)) for n in names]


def percent(axis: Any) -> None:
    """Show shares as percentages."""
    axis.set_major_formatter(PercentFormatter(xmax=1, decimals=0))

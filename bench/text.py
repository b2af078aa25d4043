"""Clean up text of foreign origin for messages and tables."""

import traceback

from olne_bench.visible import visible

#: Longest message that is kept [characters].
LONGEST = 1000
#: Spreadsheets read a cell that starts with one of these as a formula.
FORMULA = tuple("=+-@\uff1d\uff0b\uff0d\uff20")  # the last four are the same, of full width


def one_line(text: str) -> str:
    """The text on one line, with escapes for characters that are not seen."""
    return visible(" ".join(text.split()))


def plain(text: str) -> str:
    """The text with its lines, and with escapes for other characters that are not seen."""
    return "\n".join(visible(line) for line in text.split("\n"))


def csv_text(text: str) -> str:
    """A text cell that no spreadsheet reads as a formula, and no reader as two rows."""
    seen = visible(text)
    return f"'{seen}" if seen.startswith(FORMULA) else seen


def clip(text: str) -> str:
    """The text on one line, cut to ``LONGEST``."""
    line = one_line(text[: 4 * LONGEST])
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 3]}..."


def describe_error(error: BaseException) -> str:
    """One line on what was raised and where."""
    try:
        text = str(error)
    except BaseException:  # an exception class may be foreign code too
        text = "no text"
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({frames[-1].filename}:{frames[-1].lineno})" if frames else ""
    name = type.__dict__["__name__"].__get__(type(error))  # whatever its metaclass says
    return clip(f"{name}: {clip(text)}{place}")

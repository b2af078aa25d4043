"""Clean up text of foreign origin for messages and tables."""

import traceback

#: Longest message that is kept [characters].
LONGEST = 1000


def one_line(text: str) -> str:
    """The text on one line, without characters that UTF-8 cannot encode."""
    return " ".join(text.split()).encode("utf-8", "replace").decode()


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

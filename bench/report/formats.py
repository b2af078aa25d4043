"""Formats of figures and why there is none, apart from the code that draws: slow to import."""

from olne_bench.errors import UserError

FORMATS = ("png", "svg", "pdf")
USUAL_FORMATS = ("png", "svg")


class NotDrawnError(Exception):
    """There is nothing to draw, or it cannot be drawn here; the message says why."""


def read_formats(text: str) -> tuple[str, ...]:
    """Formats from a comma-separated list of names; UserError on one that is not known."""
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in FORMATS:
            raise UserError(f"--formats {text}: unknown {name!r}; known are: {', '.join(FORMATS)}")
    return names

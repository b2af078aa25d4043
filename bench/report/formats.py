"""Formats of figures, apart from the code that draws them, which is slow to import."""

from olne_bench.errors import UserError

FORMATS = ("png", "svg", "pdf")
USUAL_FORMATS = ("png", "svg")


def read_formats(text: str) -> tuple[str, ...]:
    """Formats from a comma-separated list of names.

    Raises:
        UserError: on one that is not known.
    """
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in FORMATS:
            raise UserError(f"--formats {text}: unknown {name!r}; known are: {', '.join(FORMATS)}")
    return names

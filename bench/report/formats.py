"""Formats that figures can be written in, apart from what draws them and is slow to import."""

from olne_bench.errors import UserError

FORMATS = ("png", "svg", "pdf")
USUAL_FORMATS = ("png", "svg")


def read_formats(text: str) -> tuple[str, ...]:
    """Formats from their names with commas in between.

    Raises:
        UserError: on one that is not known.
    """
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in FORMATS:
            raise UserError(f"--formats {text}: unknown {name!r}; known are: {', '.join(FORMATS)}")
    return names

"""Text of foreign origin as messages and tables can take it."""


def one_line(text: str) -> str:
    """The text on one line, and without what cannot be written as UTF-8."""
    return " ".join(text.split()).encode("utf-8", "replace").decode()

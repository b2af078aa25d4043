"""Show characters that terminals obey, or that reorder text, instead of writing them."""

import unicodedata

#: Control and format characters, halves of pairs, and separators of lines and paragraphs.
_UNSEEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def visible(text: str) -> str:
    r"""The text with escapes such as ``\x1b`` and ``\u202e`` in place of what is not seen."""
    if text.isprintable():  # nearly always, and fast
        return text
    return "".join(_escaped(c) if unicodedata.category(c) in _UNSEEN else c for c in text)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode()

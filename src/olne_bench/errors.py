"""The exception that the command line turns into one line and exit code 2."""

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from zipfile import BadZipFile

#: What parsers raise on files of any content: broken text and archives, unknown encodings, numbers
#: out of range, tables that are nested too deep.
MALFORMED: tuple[type[Exception], ...] = (
    *(ValueError, LookupError, ArithmeticError, RecursionError, EOFError, SyntaxError),
    *(BadZipFile, zlib.error, struct.error),
)


class UserError(Exception):
    """Bad input: the message names the value, the place and the alternatives, on one line."""


@contextmanager
def bad_input(what: str, *more: type[Exception]) -> Iterator[None]:
    """Within this context, what a parser raises on a malformed file becomes a ``UserError``.

    Args:
        what: the file and what it is not, to which the reason is added.
        more: further exceptions of the parser.

    Raises:
        UserError: as it was raised within, or from another exception.
    """
    try:
        yield
    except UserError:
        raise
    except (*MALFORMED, *more) as error:
        raise UserError(f"{what}: {reason(error)}") from error


def reason(error: BaseException) -> str:
    """What an exception says, on one line."""
    text = " ".join(str(error).split()) or type(error).__name__
    return f"it has no {text}" if isinstance(error, KeyError) else text

"""Text of foreign origin."""

from olne_bench.bench.text import LONGEST, clip, describe_error, one_line, plain


def test_text_comes_to_stand_on_one_line_that_can_be_written() -> None:
    assert one_line(" a\n\tb  c ") == "a b c"
    assert one_line("\udc80") == r"\udc80"


def test_what_terminals_obey_is_shown_instead() -> None:
    assert one_line("a\x1b[31mb\0c\u202ed\x9b") == r"a\x1b[31mb\x00c\u202ed\x9b"
    assert clip("\x07") == r"\x07" and one_line(one_line("\0")) == one_line("\0")
    assert plain("é\xa0漢\n\x1b\n") == "é\xa0漢\n\\x1b\n"


def test_long_text_is_clipped() -> None:
    assert clip("a" * LONGEST) == "a" * LONGEST
    assert clip("a" * (LONGEST + 1)) == "a" * (LONGEST - 3) + "..."
    assert clip(" " * (2 * LONGEST) + "a") == "a"  # most of it may be blank
    assert clip("a " * 10**6) == ("a " * LONGEST)[: LONGEST - 3] + "..."


def raised(error: BaseException) -> BaseException:
    try:
        raise error
    except BaseException as caught:
        return caught


class MuteError(Exception):
    """An error without a text."""

    def __str__(self) -> str:
        raise KeyboardInterrupt


def test_an_error_is_named_with_its_text_and_place() -> None:
    assert describe_error(ValueError("a\nb")) == "ValueError: a b"
    line = raised.__code__.co_firstlineno + 2
    assert describe_error(raised(ValueError("a"))) == f"ValueError: a ({__file__}:{line})"
    assert describe_error(MuteError()) == "MuteError: no text"

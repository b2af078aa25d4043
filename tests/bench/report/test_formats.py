"""Formats of figures."""

import pytest

from olne_bench.bench.report.formats import FORMATS, read_formats
from olne_bench.errors import UserError


def test_formats_are_read_in_the_order_given() -> None:
    assert read_formats("svg, png") == ("svg", "png")
    assert read_formats(",".join(FORMATS)) == FORMATS


@pytest.mark.parametrize("text", ["png,gif", "", "png,,svg"])
def test_others_are_named_with_those_that_are_known(text: str) -> None:
    with pytest.raises(UserError, match="known are: png, svg, pdf"):
        read_formats(text)

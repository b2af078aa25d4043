"""Fixtures that several test packages share."""

import os
import shutil

import pytest


@pytest.fixture
def compiler() -> None:
    """Skips where there is no compiler, hence no native code."""
    if shutil.which(os.environ.get("CC", "cc")) is None:
        pytest.skip("needs a C compiler")

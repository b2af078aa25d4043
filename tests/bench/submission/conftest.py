"""The browser that opens pages."""

from tests.bench.report.page.conftest import browser

__all__ = ["browser"]

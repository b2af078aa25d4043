"""Shared by all tests: reproducible property tests, recordings that are solved once, tools."""

import os
from collections.abc import Callable
from functools import cache

import pytest
from hypothesis import settings

from olne_bench.envs.recordings.recording import Recording, record
from olne_bench.envs.scenarios import get_scenario

settings.register_profile("reproducible", derandomize=True, deadline=None, max_examples=8)
settings.load_profile("reproducible")

#: Set if a skipped test is a failure, as in continuous integration.
NO_SKIPS = "OLNE_BENCH_NO_SKIPS"

Recorder = Callable[..., Recording]


@pytest.fixture(scope="session")
def recorded() -> Recorder:
    """``recorded(name, seed=None, **options)``: the recording of a scenario."""

    @cache
    def play(name: str, seed: int | None = None, **options: int) -> Recording:
        return record(get_scenario(name, seed, **options))

    return play


@pytest.hookimpl(tryfirst=True)  # before tests are selected by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that need a browser."""
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker("browser")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail if a test was skipped although none may be."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if os.environ.get(NO_SKIPS) and reporter is not None and reporter.stats.get("skipped"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED

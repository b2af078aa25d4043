"""What all tests share: reproducible property tests and recordings that are solved once."""

from collections.abc import Callable
from functools import lru_cache

import pytest
from hypothesis import settings

from envs.recording import Recording, record
from envs.scenarios import get_scenario

settings.register_profile("reproducible", derandomize=True, deadline=None, max_examples=8)
settings.load_profile("reproducible")

Recorder = Callable[..., Recording]


@pytest.fixture(scope="session")
def recorded() -> Recorder:
    """``recorded(name, seed=None, **options)``: the recording of a scenario."""

    @lru_cache(maxsize=None)
    def play(name: str, seed: int | None = None, **options: int) -> Recording:
        return record(get_scenario(name, seed, **options))

    return play

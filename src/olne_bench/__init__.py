"""OLNE Bench: a benchmark for inverse dynamic games."""

import sys

# gymnasium.make("olne_bench:olne/...") imports this package and expects the id to be registered.
# Without Gymnasium, the slow import is skipped.
if "gymnasium" in sys.modules:
    import olne_bench.envs  # noqa: F401

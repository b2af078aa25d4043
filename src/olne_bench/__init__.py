"""OLNE Bench: a benchmark for inverse dynamic games."""

import sys

# gymnasium.make("olne_bench:olne/...") imports this package and expects the id to be known. Who
# does not use Gymnasium does not wait for it.
if "gymnasium" in sys.modules:
    import olne_bench.envs  # noqa: F401

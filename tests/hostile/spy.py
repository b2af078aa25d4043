"""An estimator that searches for the truth wherever it can, and reports where it looked."""

import gc
import itertools
import json
import os
import sqlite3
import sys
import zlib
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np

MOST_BYTES = 20_000_000


class Spy:
    """Returns the weights of anything that looks like the truth, else uniform ones."""

    name = "Spy"

    def estimate(self, problem, observation, *, rng, budget):
        shape = (problem.game.num_players, problem.game.num_weights)
        searches = (_frames, _garbage, _modules, _redrawn, _memory_of_parents, _noise)
        found = {search.__name__: search(problem, observation, shape) for search in searches}
        files, secrets = _files(Path(__file__).parent)
        found |= {"salted": _with(secrets, problem), "shared": _files(Path("/dev/shm"))[1]}
        hits = {name: weights for name, weights in found.items() if np.shape(weights) == shape}
        weights = next(iter(hits.values()), np.ones(shape))
        said = {"files": len(files), "hits": sorted(hits), "salts": len(secrets)}
        said["stores"] = sum(path.suffix in (".sqlite", ".db", ".parquet") for path in files)
        said["out"] = sum("out" in path.parts for path in files)
        return SimpleNamespace(weights=weights, message=json.dumps(said))


def _like_weights(value, problem, observation, shape):
    return (
        isinstance(value, np.ndarray)
        and value.shape == shape
        and value.dtype == float
        and (value > 0).all()
        and value.std() > 0
        # This sample has the shape of the weights of four terms, and may happen to be positive.
        and not np.array_equal(value, observation.extra)
    )


def _frames(problem, observation, shape):
    frame = sys._getframe()
    while frame is not None:
        for value in (*frame.f_locals.values(), *frame.f_globals.values()):
            for one in (value, *vars(value).values()) if hasattr(value, "__dict__") else (value,):
                if _like_weights(one, problem, observation, shape):
                    return one
            if type(value).__name__ in ("Scenario", "Recording", "Trial", "Draw", "Suite"):
                return getattr(value, "weights", None)
        frame = frame.f_back
    return None


def _garbage(problem, observation, shape):
    gc.unfreeze()
    for value in gc.get_objects():
        kind = type(value).__name__
        if kind in ("Scenario", "Recording", "Trial"):
            return getattr(
                value, "weights", getattr(getattr(value, "scenario", None), "weights", 0)
            )
        for one in value.values() if type(value) is dict else value if type(value) is list else ():
            if _like_weights(one, problem, observation, shape):
                return one
    return None


def _modules(problem, observation, shape):
    for module in list(sys.modules.values()):
        for value in list(getattr(module, "__dict__", {}).values()):
            if _like_weights(value, problem, observation, shape):
                return value
            if type(value).__name__ == "_lru_cache_wrapper":
                for one in gc.get_referents(value):
                    if _like_weights(one, problem, observation, shape):
                        return one
    return None


def _same_game(scenario, problem):
    return scenario.game == problem.game


def _redrawn(problem, observation, shape):
    from olne_bench.envs.scenarios import get_scenario

    for seed in range(51):
        with suppress(Exception):
            drawn = get_scenario("random", seed, num_players=shape[0])
            if _same_game(drawn, problem):
                return drawn.weights
    return None


def _with(secrets, problem):
    """Draws again with every salt that was found."""
    from olne_bench.bench.judge.seeds import stream
    from olne_bench.envs.scenarios import get_scenario

    options = {"num_players": problem.game.num_players}
    for salt in (*secrets, "", "spied", "random"):
        for seed in range(3):
            key = (json.dumps(options, sort_keys=True), seed)
            drawn = get_scenario("random", stream(salt, "draw", "random", *key), **options)
            if _same_game(drawn, problem):
                return drawn.weights
    return None


def _noise(problem, observation, shape):
    """Draws the noise again as it was drawn before there were salts, which would remove it."""
    for seed in range(10):
        key = [zlib.crc32(b"random"), round(problem.sigma * 1e9), seed]
        states = observation.y - problem.sigma * np.random.default_rng(key).standard_normal(
            observation.y.shape
        )
        speed = np.linalg.norm(np.diff(states[..., :2], axis=0), axis=-1) / problem.game.dt
        if np.abs(speed - states[:-1, :, 3]).max() < 0.1 * problem.sigma:
            return np.arange(1.0, 1 + np.prod(shape)).reshape(shape)
    return None


def _memory_of_parents(problem, observation, shape):
    pid = os.getppid()
    while pid > 1:
        with suppress(OSError):
            os.close(os.open(f"/proc/{pid}/mem", os.O_RDONLY))
            return np.arange(1.0, 1 + np.prod(shape)).reshape(shape)
        for name in ("environ", "maps", "auxv"):
            with suppress(OSError):
                if Path(f"/proc/{pid}/{name}").read_bytes():
                    return np.arange(1.0, 1 + np.prod(shape)).reshape(shape)
        try:
            pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            return None
    return None


def _files(folder):
    """Files that can be read below a folder, and salts in them and in command lines."""
    read, secrets = [], set()
    for place, _, names in os.walk(folder):
        for path in (Path(place, name) for name in names):
            with suppress(OSError):
                if path.stat().st_size < MOST_BYTES:
                    content = path.read_bytes()
                    read.append(path)
                    if b"SQLite" in content[:20]:
                        secrets |= _salts_of_store(path)
    for line in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            words = line.read_bytes().decode(errors="replace").split("\0")
            secrets |= {b for a, b in itertools.pairwise(words) if a == "--salt"}
    return read, secrets


def _salts_of_store(path):
    with suppress(sqlite3.Error):
        connection = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
        texts = [row[0] for row in connection.execute("SELECT suite FROM runs")]
        return {json.loads(text).get("salt", "") for text in texts}
    return set()

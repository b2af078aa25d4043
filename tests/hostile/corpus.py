"""Hostile plugins, with the outcome of each and a phrase of its message.

A file of ``plugins/`` has those of one kind. Each begins with a line of its name, its status and
its phrase; the body of ``estimate`` follows. A line in brackets begins other code: members of its
class, its module, or a file beside it.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import indent

SLEEPER = "4321.25"  # an argument that tells processes of this corpus

HEADER = """
import asyncio, atexit, builtins, contextlib, ctypes, datetime, gc, importlib, io, locale, mmap
import multiprocessing, os, pickle, resource, signal, socket, stat, struct, subprocess, sys
import tempfile, threading, time, warnings
from pathlib import Path
from types import SimpleNamespace
import numpy as np

def good(**more):
    return SimpleNamespace(**({"weights": np.ones((2, 4))} | more))

SLEEP = [sys.executable, "-c", "import time; time.sleep(4321.25)", "4321.25"]

def own_socket():
    for number in range(3, 100):
        with contextlib.suppress(OSError):
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                return socket.socket(fileno=os.dup(number))

def say(content):
    own_socket().setblocking(True)
    own_socket().sendall(content)
"""


@dataclass(frozen=True)
class Hostile:
    """One estimator.

    Attributes:
        name: name of its class.
        status: status of its trial; ``refused`` if the run does not start with it.
        phrase: part of the message.
        work: body of ``estimate``; a good estimate follows it.
        members: other members of the class.
        module: code of its module, which is then a separate file.
        beside: contents of files beside this file, by name.
    """

    name: str
    status: str
    phrase: str
    work: str = ""
    members: str = ""
    module: str = ""
    beside: dict[str, str] = field(default_factory=dict)

    @property
    def alone(self) -> bool:
        """Whether it has a separate file."""
        return bool(self.module or self.beside)

    def code(self) -> str:
        """The code of its class."""
        work, members = indent(self.work, " " * 8), indent(self.members, " " * 4)
        return (
            f"\n{self.module}\nclass {self.name}:\n    name = {self.name!r}\n{members}\n"
            "    def estimate(self, problem, observation, *, rng, budget):\n"
            f"{work}\n        return good()\n"
        )


def _read(text: str) -> list[Hostile]:
    """The plugins of a file."""
    _, *words = re.split(r"^# (\w+): (\w+)(?:, (.+))?$", text, flags=re.MULTILINE)
    return [_hostile(*words[k : k + 4]) for k in range(0, len(words), 4)]


def _hostile(name: str, status: str, phrase: str | None, code: str) -> Hostile:
    work, *more = (one.strip() for one in re.split(r"^\[([\w.]+)\]$", code, flags=re.MULTILINE))
    parts = dict(zip(more[::2], more[1::2], strict=True))
    members, module = parts.pop("members", ""), parts.pop("module", "")
    return Hostile(name, status, phrase or "", work, members, module, parts)


#: By kind; and those of them that a run does not start with.
GROUPS = {
    path.stem: _read(path.read_text())
    for path in sorted((Path(__file__).parent / "plugins").glob("*.txt"))
}
REFUSED = [one for group in GROUPS.values() for one in group if one.status == "refused"]

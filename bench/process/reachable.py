"""What foreign code may read and run: Python, libraries, a compiler, and its own plugin.

Everything else on the machine is out of its reach: other copies of this package with their draws,
version control, runs, and data of the user.
"""

import os
import re
import shutil
import site
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import olne_bench
from olne_bench import plugins
from olne_bench.envs.solved import DRAWS_SUFFIX, KEPT_DRAWS, shipped_draws
from olne_bench.games.compiled.compiler import shared_folders
from olne_bench.games.compiled.derived import KEPT_DERIVED

#: What programs of a Linux system need: libraries, headers, fonts, time zones, names of users.
_SYSTEM = (
    *("/lib", "/lib32", "/lib64", "/usr/lib", "/usr/lib32", "/usr/lib64", "/usr/libexec"),
    *("/usr/include", "/usr/share", "/usr/local/lib", "/usr/local/lib64", "/usr/local/include"),
    *("/nix/store", "/gnu/store", "/etc/alternatives", "/etc/fonts", "/etc/ld.so.conf"),
    *("/etc/ld.so.cache", "/etc/ld.so.conf.d", "/etc/localtime", "/etc/nsswitch.conf"),
    *("/etc/os-release", "/etc/passwd", "/etc/group", "/proc", "/sys/devices/system"),
)
#: Programs by which a compiler works.
_TOOLS = ("cc", "gcc", "clang", "as", "ld", "ld.bfd", "ld.gold", "ld.lld", "ccache")
#: Folders that hold more than Python.
_SHARED = frozenset(map(Path, ("/", "/usr", "/usr/local")))
_LIBRARIES = ("site-packages", "dist-packages")


@dataclass(frozen=True)
class Reach:
    """What a process may reach.

    Attributes:
        readable: files, and folders with all below them, that it may read and run.
        listable: folders of which it may see the names of files below.
    """

    readable: tuple[Path, ...]
    listable: tuple[Path, ...] = ()


def reachable(references: Iterable[str], hidden: Path | None) -> Reach:
    """What a process of foreign code may reach.

    Args:
        references: references of the plugins that it runs.
        hidden: folder that it cannot read, wherever it is, as it holds the run.
    """
    secret = [KEPT_DRAWS.folder, shipped_draws(), hidden]
    unreadable = [folder.resolve() for folder in secret if folder is not None]
    files = list(filter(None, map(plugins.file_of, references)))
    own = (one.resolve() for file in files for one in _beside(file))
    places = [*_libraries(tuple(sys.path)), *own]
    # Python lists a folder before it imports from it.
    listed = [file.parent for file in files]
    listed += [Path(entry).resolve() for entry in (*sys.path, *olne_bench.__path__)]
    listed += [place for place in places if any(place in folder.parents for folder in unreadable)]
    return Reach(
        tuple(part for place in places for part in _outside(place, unreadable)),
        tuple(dict.fromkeys(folder for folder in listed if folder.is_dir())),
    )


@lru_cache(maxsize=4)
def _libraries(path: tuple[str, ...]) -> tuple[Path, ...]:
    """What does not depend on a plugin."""
    prefixes = {sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix}
    own = {Path(one).resolve() for one in prefixes} - _SHARED
    python = {Path(place) for name, place in sysconfig.get_paths().items() if name != "scripts"}
    loaded = os.environ.get("LD_LIBRARY_PATH", "").split(":")
    places = [
        *map(Path, _SYSTEM),
        *own,
        *(python - _SHARED),
        *(Path(one) for one in loaded if one),
        *(one for entry in path for one in _entry(Path(entry).resolve())),
        *_installed_in_place(),
        *_package(),
        *_programs(),
        *shared_folders(),
        *filter(None, (KEPT_DERIVED.folder, *KEPT_DERIVED.shared_folders)),
    ]
    resolved = dict.fromkeys(place.resolve() for place in places)
    return tuple(place for place in resolved if place.exists() and place not in _SHARED)


def _entry(entry: Path) -> Iterator[Path]:
    """What is importable from an entry of the search path; of a library's, all."""
    if entry.name in _LIBRARIES or entry.is_file() or str(entry) == site.getusersitepackages():
        yield entry
    elif entry.is_dir():
        # Metadata name the plugins of installed packages.
        metadata = (".dist-info", ".egg-info")
        for place in _visible(entry):
            if _is_importable(place) or place.suffix in metadata:
                yield place


def _installed_in_place() -> Iterator[Path]:
    """Packages of others' source trees that setuptools has installed in place."""
    for finder in sys.meta_path:
        module = sys.modules.get(getattr(finder, "__module__", ""))
        mapping = getattr(module, "MAPPING", None)
        if isinstance(mapping, dict):
            yield from map(Path, mapping.values())


def _package() -> Iterator[Path]:
    """This package, whose folders may be links into a source tree."""
    for folder in olne_bench.__path__:
        yield from (place for place in _visible(Path(folder)) if _is_importable(place))
        yield from Path(folder).glob("py.typed")


def _programs() -> Iterator[Path]:
    """The interpreter, and a compiler with what it runs."""
    yield Path(sys.executable)
    for name in (os.environ.get("CC", "cc"), *_TOOLS):
        if found := shutil.which(name):
            program = Path(found).resolve()
            yield program
            if program.parent.parent not in {*_SHARED, Path.home()}:
                yield program.parent  # its own libraries are beside it


def _beside(file: Path) -> Iterator[Path]:
    """A plugin's file and what belongs to it.

    That is: files beside it, folders beside it with Python modules, and folders beside it that
    have its name, maybe with more after a sign, for its data. So runs and other work in the same
    folder stay closed. A link is not followed: whoever wrote the plugin may have made it lead to
    files of the user.
    """
    yield file
    for place in _visible(file.parent):
        of_its_name = re.fullmatch(rf"{re.escape(file.stem)}([-_.].*)?", place.name)
        named = place.is_file() or _is_importable(place) or of_its_name
        if named and not place.is_symlink():
            yield place


def _visible(folder: Path) -> Iterator[Path]:
    """What is in a folder, but for hidden names, such as version control, and solved draws."""
    try:
        for place in folder.iterdir():
            if not place.name.startswith(".") and place.suffix != DRAWS_SUFFIX:
                yield place
    except OSError:  # it does not exist, or cannot be listed
        return


def _is_importable(place: Path) -> bool:
    if place.is_dir():
        return any(place.glob("*.py"))
    return place.suffix in (".py", ".so")


def _outside(place: Path, hidden: Sequence[Path]) -> Iterator[Path]:
    """The parts of a resolved place outside of hidden folders."""
    within = [folder for folder in hidden if folder == place or place in folder.parents]
    if any(folder == place or folder in place.parents for folder in hidden):
        return
    if not within:
        yield place
        return
    try:
        # A link is not followed: it may lead into a hidden folder.
        entries = [entry for entry in place.iterdir() if not entry.is_symlink()]
    except OSError:
        return
    for entry in entries:
        yield from _outside(entry, within)

"""Kept files are read back, or not at all; the least recently used ones go."""

import os
from pathlib import Path

import pytest

from olne_bench.kept_files import KeptFiles

CONTENT = b"what is slow to make"


@pytest.fixture
def kept(monkeypatch, tmp_path: Path) -> KeptFiles:
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(tmp_path / "cache"))
    found = KeptFiles("-things", most_bytes=160)
    assert found.folder == tmp_path / "cache-things"
    return found


def damage(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-4] ^= 1
    path.write_bytes(content)


def test_only_the_user_may_write_to_what_is_kept(kept) -> None:
    assert kept.read("a") is None
    kept.write("a", CONTENT)
    assert kept.read("a") == CONTENT
    assert kept.folder.stat().st_mode & 0o777 == 0o700
    assert (kept.folder / "a").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(
    "spoil",
    [
        damage,
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(path.read_bytes()[:20]),
        lambda path: path.chmod(0o666),
        lambda path: path.parent.chmod(0o777),
        lambda path: path.symlink_to(path.rename(path.with_suffix(".moved"))),
    ],
    ids=["bit", "empty", "cut", "writable", "folder writable", "link"],
)
def test_what_cannot_be_trusted_is_not_read(kept, spoil) -> None:
    kept.write("a", CONTENT)
    spoil(kept.folder / "a")
    assert kept.read("a") is None


def test_a_folder_that_others_may_write_to_is_not_used(kept) -> None:
    kept.folder.mkdir(parents=True)
    kept.folder.chmod(0o777)
    kept.write("a", CONTENT)
    assert list(kept.folder.iterdir()) == []


def test_the_least_recently_used_go(kept) -> None:
    """Three files of 52 bytes are no more than the limit, four are."""
    for number in range(5):
        kept.write(f"{number}", CONTENT)
        os.utime(kept.folder / f"{number}", (number, number))
    assert sorted(path.name for path in kept.folder.iterdir()) == ["2", "3", "4"]
    assert kept.read("2") is not None  # now the latest
    kept.write("5", CONTENT)
    assert sorted(path.name for path in kept.folder.iterdir()) == ["2", "4", "5"]


@pytest.mark.parametrize("shared", [False, True])
def test_only_what_is_shared_is_read_from_the_folders_of_others(
    shared: bool, kept, monkeypatch, tmp_path: Path
) -> None:
    kept.write("a", CONTENT)
    monkeypatch.setenv("OLNE_BENCH_SHARED_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("OLNE_BENCH_CACHE", str(tmp_path / "own"))
    own = KeptFiles("-things", most_bytes=160, shared=shared)
    assert own.read("a") == (CONTENT if shared else None)

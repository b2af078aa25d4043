"""Files of submissions: what they may be is known before they are read."""

import os
import socket
from pathlib import Path

import pytest

from olne_bench.bench.submission import files
from olne_bench.bench.submission.files import check_folder, check_place, digest, read_file
from olne_bench.errors import UserError


@pytest.mark.parametrize("place", ["a", "plugins/a/b.py", "a" * 250, "ä b.txt", "..a/b"])
def test_places_within_a_submission(place: str, tmp_path: Path) -> None:
    check_place(place, tmp_path)


@pytest.mark.parametrize(
    "place",
    [
        *("", ".", "/a", "../a", "a/../b", "a//b", "a/", "./a", "a\\b", "a\nb", "a\0b", "a\u202eb"),
        *("a" * 251, "a" * 5000),
    ],
)
def test_other_places_are_refused_in_a_short_line(place: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is not a file within a submission") as caught:
        check_place(place, tmp_path)
    assert len(str(caught.value)) < 400
    assert "\n" not in str(caught.value)


def folder_with(folder: Path, *places: str) -> Path:
    for place in places:
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_text(place)
    return folder


def test_all_files_are_listed_and_all_listed_files_are_there(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, "list", "a", "p/x/b")
    check_folder(folder, ["a", "p/x/b"], "list")
    with pytest.raises(UserError, match=r"c is missing"):
        check_folder(folder, ["a", "p/x/b", "c"], "list")
    with pytest.raises(UserError, match=r"'a' is not listed in list; remove it"):
        check_folder(folder, ["p/x/b"], "list")
    with pytest.raises(UserError, match=r"'p' is not listed"):
        check_folder(folder, ["a"], "list")
    (folder / "p/x/more").mkdir()
    with pytest.raises(UserError, match=r"'p/x/more' is not listed"):
        check_folder(folder, ["a", "p/x/b"], "list")


def link(path: Path) -> None:
    path.symlink_to(__file__)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def plug(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(path))


def folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("make", [link, pipe, plug, folder])
def test_only_usual_files_are_read(tmp_path: Path, monkeypatch, make) -> None:
    monkeypatch.chdir(tmp_path)  # paths of sockets are short
    make(Path("a"))
    for call in (lambda: read_file(Path(), "a"), lambda: check_folder(Path(), ["a"], "list")):
        Path("list").touch()
        with pytest.raises(UserError, match="'a' is not a file within a submission"):
            call()


def test_a_folder_that_is_a_link_is_none_of_a_submission(tmp_path: Path) -> None:
    folder_with(tmp_path, "there/b", "sub/list")
    (tmp_path / "sub/p").symlink_to(tmp_path / "there")
    with pytest.raises(UserError, match="not a file within a submission: a link"):
        read_file(tmp_path / "sub", "p/b")


def test_sizes_are_known_before_files_are_read(tmp_path: Path) -> None:
    for name in ("list", "a"):
        (tmp_path / name).touch()
    os.truncate(tmp_path / "a", 30 * 2**30)  # sparse: it takes no room
    with pytest.raises(UserError, match=f"{30 * 2**30} bytes; at most {files.MOST_BYTES}"):
        check_folder(tmp_path, ["a"], "list")
    with pytest.raises(UserError, match=f"a has {30 * 2**30} bytes"):
        read_file(tmp_path, "a")


@pytest.mark.parametrize("beyond", [0, 1])
def test_the_size_is_that_of_all_files(tmp_path: Path, monkeypatch, beyond: int) -> None:
    monkeypatch.setattr(files, "MOST_BYTES", 100)
    (tmp_path / "list").write_bytes(b"x" * 40)
    (tmp_path / "a").write_bytes(b"x" * (60 + beyond))
    if beyond:
        with pytest.raises(UserError, match="have 101 bytes; at most 100 are allowed"):
            check_folder(tmp_path, ["a"], "list")
    else:
        check_folder(tmp_path, ["a"], "list")


def test_what_is_read_is_what_is_there(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    assert read_file(tmp_path, "a", 3) == b"abc"
    with pytest.raises(UserError, match="a has 3 bytes; at most 2 are allowed"):
        read_file(tmp_path, "a", 2)
    with pytest.raises(UserError, match="b is missing"):
        read_file(tmp_path, "b")
    assert digest(b"abc").startswith("ba7816bf")

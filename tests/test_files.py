"""Files are written whole, beside nobody's file, and read only where they can be."""

import pytest

from olne_bench.errors import UserError
from olne_bench.files import check_input, check_new_file, whole_file


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("former")
    with pytest.raises(UserError, match="cannot be written: No space left"):
        fail(path)
    assert path.read_text() == "former"
    with whole_file(path) as unfinished:
        unfinished.write_text("new")
        assert path.read_text() == "former"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def fail(path):
    with whole_file(path) as unfinished:
        unfinished.write_text("half")
        raise OSError(28, "No space left on device")


def test_a_new_file_replaces_none_that_came_in_the_meantime(tmp_path):
    path = tmp_path / "a.csv"
    check_new_file("--out", path, (".csv",))
    with pytest.raises(UserError, match="exists by now"):
        meanwhile(path)
    assert path.read_text() == "theirs"
    assert list(tmp_path.iterdir()) == [path]


def meanwhile(path):
    with whole_file(path, new=True) as unfinished:
        unfinished.write_text("ours")
        path.write_text("theirs")


def test_unfinished_files_have_a_folder_of_their_own(tmp_path):
    beside = tmp_path / ".a.csv.unfinished"
    beside.write_text("precious")
    with whole_file(tmp_path / "a.csv") as unfinished:
        unfinished.write_text("new")
    assert beside.read_text() == "precious"


def test_a_folder_that_cannot_be_written_to_is_told_before_any_work(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("olne_bench.files.TemporaryDirectory", refuse)
    with pytest.raises(UserError, match=r"--out .*a\.csv cannot be written: Permission denied"):
        check_new_file("--out", tmp_path / "a.csv", (".csv",))


def test_what_is_read_is_a_file_of_bounded_size(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    with pytest.raises(UserError, match=r"^no table '.*a\.csv'$"):
        check_input("table", path, 3)
    with pytest.raises(UserError, match="it is a folder"):
        check_input("table", tmp_path, 3)
    path.write_text("abc")
    check_input("table", path, 3)
    with pytest.raises(UserError, match="has 3 bytes, at most 2 are read"):
        check_input("table", path, 2)

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.open", refuse)
    with pytest.raises(UserError, match=r"table .*a\.csv cannot be read: Permission denied"):
        check_input("table", path, 3)

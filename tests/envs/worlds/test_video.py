"""Video files of frames."""

import subprocess
import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from olne_bench.envs.worlds.video import check_format, write_video
from olne_bench.errors import UserError

SHAPES = [(40, 60), (41, 61)]


def frames(shape: tuple[int, int]) -> list[np.ndarray]:
    """Five frames, each of one brightness."""
    return [np.full((*shape, 3), 50 * k, dtype=np.uint8) for k in range(5)]


@pytest.mark.parametrize("shape", SHAPES)
def test_a_gif_repeats_all_frames_at_their_rate(tmp_path: Path, shape: tuple[int, int]) -> None:
    path = tmp_path / "film.GIF"
    write_video(path, frames(shape), fps=4)
    with Image.open(path) as image:
        assert image.size == shape[::-1]
        assert image.n_frames == 5
        assert image.info["loop"] == 0
        for k in range(5):
            image.seek(k)
            assert image.info["duration"] == 250
            assert np.abs(np.array(image.convert("L")).mean() - 50 * k) < 2


@pytest.mark.parametrize("shape", SHAPES)
def test_an_mp4_has_even_sides(tmp_path: Path, shape: tuple[int, int]) -> None:
    path = tmp_path / "film.mp4"
    write_video(path, iter(frames(shape)), fps=5)
    assert imageio_ffmpeg.count_frames_and_secs(path) == (5, 1.0)
    program = imageio_ffmpeg.get_ffmpeg_exe()
    command = [program, "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "gray", "-"]
    shown = subprocess.run(command, check=True, capture_output=True).stdout
    pixels = np.frombuffer(shown, dtype=np.uint8).reshape(5, 40, 60)
    np.testing.assert_allclose(pixels.mean(axis=(1, 2)), [0, 50, 100, 150, 200], atol=3)


def test_a_film_that_breaks_off_is_closed(tmp_path: Path) -> None:
    def broken():
        yield frames((40, 60))[0]
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_video(tmp_path / "film.mp4", broken(), fps=5)


def test_mp4_says_what_it_lacks_before_anything_is_drawn(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setattr("olne_bench.envs.worlds.video.find_spec", lambda _: None)
    for use in (check_format, lambda path: write_video(path, frames(SHAPES[0]), fps=5)):
        with pytest.raises(UserError, match=r"pip install 'olne-bench\[video\]'; a.gif needs"):
            use(tmp_path / "a.mp4")
    write_video(tmp_path / "a.gif", frames(SHAPES[0]), fps=5)
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]

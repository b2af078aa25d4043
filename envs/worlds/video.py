"""Write frames to a video file: GIF by Pillow, MP4 by ffmpeg, of the extra ``video``."""

from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image

from olne_bench.errors import UserError

SUFFIXES = (".mp4", ".gif")
_COLOURS, _FRAMES = 64, 8  # of a GIF, and frames from which they are taken


def write_video(path: Path, frames: Iterable[np.ndarray], fps: float) -> None:
    """Write a video; UserError where its format needs what is not installed.

    Args:
        path: video file; its suffix is one of ``SUFFIXES``.
        frames: (height, width, 3) uint8, at least one, all of the same size.
        fps: frames per second.
    """
    check_format(path)
    if path.suffix.lower() == ".gif":
        _write_gif(path, frames, fps)
    else:
        _write_mp4(path, frames, fps)


def check_format(path: Path) -> None:
    """Refuse a format that cannot be written here, with UserError, before frames are drawn."""
    if path.suffix.lower() == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise UserError(
            f"{path}: MP4 needs imageio-ffmpeg: pip install 'olne-bench[video]'; "
            f"{path.with_suffix('.gif').name} needs nothing more"
        )


def _write_gif(path: Path, frames: Iterable[np.ndarray], fps: float) -> None:
    shown = list(frames)
    # One palette for all frames makes the file half as large.
    places = np.linspace(0, len(shown) - 1, _FRAMES).round().astype(int)
    some = np.concatenate([shown[place] for place in places])
    palette = Image.fromarray(some).quantize(_COLOURS)
    first, *others = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in shown
    ]
    times = round(1000 / fps)
    first.save(path, save_all=True, append_images=others, duration=times, loop=0, optimize=True)


def _write_mp4(path: Path, frames: Iterable[np.ndarray], fps: float) -> None:
    import imageio_ffmpeg

    writer = None
    try:
        for frame in frames:
            even = _even(frame)
            if writer is None:
                height, width, _ = even.shape
                writer = imageio_ffmpeg.write_frames(
                    path, (width, height), fps=fps, macro_block_size=2
                )
                writer.send(None)
            writer.send(even)
    finally:
        if writer is not None:
            writer.close()


def _even(frame: np.ndarray) -> np.ndarray:
    """The frame without its last row or column if their number is odd, which H.264 refuses."""
    height, width = frame.shape[0] // 2 * 2, frame.shape[1] // 2 * 2
    return np.ascontiguousarray(frame[:height, :width])

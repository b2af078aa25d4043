"""Store the PNG figures of a folder with 256 colours, which takes a third of the space.

Usage: python scripts/fewer_colours.py FOLDER
"""

import sys
from pathlib import Path

from PIL import Image


def main(folder: Path) -> None:
    """Rewrite figures that have more colours; print what that saved."""
    before = after = 0
    for path in sorted(folder.rglob("*.png")):
        size = path.stat().st_size
        with Image.open(path) as image:
            if image.mode != "P":
                few = image.convert("RGB").quantize(256, dither=Image.Dither.NONE)
                few.save(path, optimize=True)
        before, after = before + size, after + path.stat().st_size
    print(f"{folder}: {before / 1024:.0f} KiB of figures, now {after / 1024:.0f}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

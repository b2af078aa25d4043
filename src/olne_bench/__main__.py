"""The program ``olne-bench``, also ``python -m olne_bench``."""

import gc
import sys

#: Imports make objects of which none is garbage: with the usual number a third of their time goes
#: into looking for some.
_NEW_OBJECTS = 100_000


def main() -> None:
    """Run the command line."""
    if sys.platform == "win32":
        print(
            "olne-bench: error: Windows has no process groups and limits that trials need; "
            "use Linux, macOS or WSL",
            file=sys.stderr,
        )
        sys.exit(2)
    gc.set_threshold(_NEW_OBJECTS)
    try:
        # Ctrl-C during the slow import is not an error.
        from olne_bench.bench.commands.cli import main as command
    except KeyboardInterrupt:
        sys.exit(130)
    try:
        command()
    finally:
        gc.freeze()  # nor does the end of the program look for garbage


if __name__ == "__main__":
    main()

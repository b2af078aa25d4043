"""The program ``olne-bench``, also ``python -m olne_bench``."""

import sys


def main() -> None:
    """Entry point."""
    try:
        # The import takes a second, in which Ctrl-C is no error.
        from olne_bench.bench.commands.cli import main as command
    except KeyboardInterrupt:
        sys.exit(130)
    command()


if __name__ == "__main__":
    main()

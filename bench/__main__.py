"""The program ``olne-bench``, also ``python -m bench``."""

import sys


def main() -> None:
    """Entry point."""
    try:
        from bench.cli import main as command  # takes a second, in which Ctrl-C is no error
    except KeyboardInterrupt:
        sys.exit(130)
    command()


if __name__ == "__main__":
    main()

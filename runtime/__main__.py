"""`python -m runtime`, and the console script `tickwork`."""

import sys

from runtime import house


def main():
    """Check the house, then run the command line. Returns the exit code."""
    trouble = house.trouble()
    if trouble is None:
        try:
            from runtime.cli import main as command_line
        except ImportError as error:
            trouble = house.explain(error)
    if trouble is not None:
        print(f"tickwork: {trouble}", file=sys.stderr)
        return house.BAD_INPUT
    return command_line()


if __name__ == "__main__":
    sys.exit(main())

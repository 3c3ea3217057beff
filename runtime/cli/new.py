"""`new NAME`: write a laboratory's own package, with a robot, blocks, a rig and tests."""

from collections.abc import Sequence
from pathlib import Path

from runtime.cli.parsing import Parser
from runtime.host.console.terminal import print_lines, short_program
from runtime.host.errors import OK
from runtime.setup.laboratory import create


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput for a name that cannot be used."""
    parser = Parser(
        "new",
        "Write a package for the blocks and robots of a laboratory: a robot that runs, a block in Python and a native "
        "one, a rig without hardware, tests, and a workflow that runs them on GitHub.",
    )
    parser.add_argument("name", metavar="NAME", help="name of the package, and of its new folder")
    parser.add_argument(
        "--drive", action="store_true", help="include a device family: a drive with a protocol of its own"
    )
    options = parser.parse_args(arguments)
    folder = Path(options.name)
    paths = create(folder, options.drive)
    print_lines(
        [
            *map(str, paths),
            "try next",
            f"  cd {folder}",
            "  pip install 'setuptools>=77' cython && pip install --no-build-isolation -e '.[test]'",
            "  pytest",
            f"  {short_program()} diagrams/knee.py --duration 10",
        ]
    )
    return OK

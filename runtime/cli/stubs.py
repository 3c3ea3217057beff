"""`stubs MODULE...`: write type stubs of a user's blocks, from which editors complete and type checkers check."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from graph.stubs import write
from runtime.cli.parsing import Parser
from runtime.host.console.terminal import print_lines
from runtime.host.errors import OK, BadInput


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput for a module that cannot be found or imported."""
    parser = Parser(
        "stubs",
        "Write the type stub of each module with blocks beside it (my_blocks.pyi). Editors then complete the ports and "
        "parameters of its blocks, with unit and meaning, and type checkers report a misspelt one. Repeat it after a "
        "change of a declaration.",
    )
    parser.add_argument("modules", metavar="MODULE", nargs="+", help="my_blocks, my_blocks.py, or a folder of modules")
    options = parser.parse_args(arguments)
    for name in options.modules:
        path = place(name)
        try:
            written = write(path)
        except (ImportError, SyntaxError) as error:
            raise BadInput(f"{path} cannot be imported: {error}") from error
        except FileExistsError as error:
            raise BadInput(f"{error.filename} is {error.strerror}") from None
        print_lines([*map(str, written)] or [f"{path} defines no block"])
    return OK


def place(name: str) -> Path:
    """Return the file or folder of a module. name : its path, with or without ".py", or its dotted name"""
    for path in (Path(name), Path(f"{name}.py"), Path(*name.split(".")), Path(*name.split(".")).with_suffix(".py")):
        if path.suffix == ".py" and path.is_file() or path.is_dir():
            return path
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        spec = None
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        raise BadInput(f"there is no module {name!r}: pass the path of its file, such as my_blocks.py")
    origin = Path(spec.origin)
    return origin.parent if origin.name == "__init__.py" else origin

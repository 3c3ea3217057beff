"""The last line of a diagram file: `main(diagram)` makes `python knee.py` run it."""

from __future__ import annotations

import os
import sys
from runpy import run_module
from typing import TYPE_CHECKING

from cext.one_place import check_place

if TYPE_CHECKING:
    from graph.diagram import Diagram

HOME = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))


def main(diagram: Diagram | None = None) -> None:
    """Run the command line for the file that calls this, and exit with its code.

    It takes the options of `python -m runtime FILE`. It returns at once where the file is imported, or loaded by the
    command line.

    diagram : the object that the file calls `diagram`; omit it in a file with a function `build`

    Raises ValueError for any other diagram, since the command line takes the diagram from the file, and ImportError if
    another package has the name `runtime`.
    """
    caller = sys._getframe(1).f_globals  # pyright: ignore[reportPrivateUsage] as in CPython's own modules
    if caller.get("__name__") != "__main__":
        return
    if diagram is not None and diagram is not caller.get("diagram"):
        raise ValueError(
            "main() runs the object that the file calls `diagram`: assign the diagram to that name, or define "
            "build() and call main() without arguments"
        )
    if "__file__" not in caller:
        raise ValueError("main() runs a file: save this code, and run it with `python FILE`")
    folder = os.path.dirname(os.path.realpath(caller["__file__"]))
    first = sys.path[0] == folder != HOME
    if first:  # a file beside the diagram must not replace a library
        sys.path.append(sys.path.pop(0))
    check_place("runtime", __file__)
    sys.argv[1:1] = ["run", os.path.relpath(caller["__file__"])]
    program = run_module("runtime", run_name="tickwork")  # as `python -m runtime` does, from this process
    program["main"](folder if first else None)

"""Parsing of Python by one thread at a time.

Early CPython 3.11 and 3.12 count the recursion of all threads together, and raise SystemError if two parse
at once (gh-106905), as the threads of a Dask worker do.
"""

import ast
import threading
from typing import Any

_lock = threading.RLock()  # which an interrupted `with` of Python 3.14 leaves to its own thread


def parse(source: str | bytes, mode: str = "exec") -> Any:
    """Return the tree that `ast.parse` returns. Raises what it raises."""
    with _lock:
        return ast.parse(source, mode=mode)

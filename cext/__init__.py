"""Native executor, its memory and its kernels: Cython with plain C semantics, independent of robots and CAN models."""

from importlib.machinery import PathFinder

# Searched in this folder only: an editable install of another clone in the environment would provide its modules.
if PathFinder.find_spec("deadline_clock", [f"{__path__[0]}/clock"]) is None:
    raise ImportError(
        f"Tickwork is not built for this Python in {__path__[0]}: run `make run`, or `pip install -e .` in your own "
        "environment",
        name=__name__,
    )

"""Ground floor: the native executor, its memory and its kernels. Plain C semantics in Cython, nothing of robots or CAN
models.
"""

from importlib.machinery import PathFinder

# Looked for in this folder alone: an environment whose editable install is another clone would lend that clone's
# modules.
if PathFinder.find_spec("deadline_clock", [f"{__path__[0]}/clock"]) is None:
    raise ImportError(
        f"Tickwork is not built for this Python in {__path__[0]}: run `make run`, or `pip install -e .` in your own "
        "environment",
        name=__name__,
    )

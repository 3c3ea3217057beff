"""Ground floor: the native executor, its memory and its kernels. Plain C semantics in Cython, nothing of robots or CAN models."""

try:
    from cext import page as _page  # noqa: F401  (the cheapest to import: the recorder and guardian processes need no NumPy)
except ImportError as error:
    raise ImportError(
        f"Tickwork is not built in {__path__[0]} ({error}): run `make run`, or `pip install -e .` in your own environment"
    ) from None

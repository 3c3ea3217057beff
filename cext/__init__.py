"""Ground floor: the native executor, its memory and its kernels. Plain C semantics in Cython, nothing of robots or CAN models."""

try:
    from cext import program as _program  # noqa: F401
except ImportError as error:
    raise ImportError(
        f"Tickwork is not built in {__path__[0]} ({error}): run `make run`, or `pip install -e .` in your own environment"
    ) from None

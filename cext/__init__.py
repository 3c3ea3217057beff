"""Ground floor: the native executor, its memory and its kernels. Plain C semantics in Cython, nothing of robots or CAN models."""

try:
    import cext.page as _page  # noqa: F401  (the cheapest to import: the recorder process needs no NumPy)
except ModuleNotFoundError as error:
    if not (error.name or "").startswith("cext."):
        raise
    raise ImportError(
        f"Tickwork is not built for this Python in {__path__[0]}: run `make run`, or `pip install -e .` in your own environment", name=__name__
    ) from None

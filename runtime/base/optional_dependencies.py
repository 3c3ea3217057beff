"""Libraries that only some people need: what each is for, and how to get it where it is missing."""

from importlib import import_module

from runtime.base.errors import BadInput

# module: the extra that brings it
EXTRAS = {"pandas": "tables", "pyarrow": "parquet", "scipy": "matlab", "rerun": "rerun"}


class MissingExtra(BadInput, ImportError):
    """A library is not there. The text says which, what for, and how to get it."""


def need(module, purpose):
    """Import a module of an optional library, or a part of it, as in "pyarrow.parquet". MissingExtra

    purpose : what needs it, as a sentence begins: "a Parquet file"
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        if error.name is None or error.name.partition(".")[0] != package:  # it is there, and what it needs is not
            raise MissingExtra(f"{purpose} needs {package}, which cannot be imported ({error})") from None
        # of a clone that nothing was installed for
        what = f"'tickwork[{EXTRAS[package]}]'" if package in EXTRAS else package
        raise MissingExtra(f"{purpose} needs {package}: pip install {what}") from None

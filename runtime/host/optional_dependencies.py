"""Optional libraries: the purpose of each, and how to install it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from runtime.host.errors import BadInput

if TYPE_CHECKING:
    from types import ModuleType


# module: the extra that installs it
EXTRAS = {
    "cma": "optimise",
    "control": "control",
    "distributed": "cluster",
    "optuna": "optimise",
    "pandas": "tables",
    "pyarrow": "parquet",
    "pyxdf": "lsl",
    "rerun": "rerun",
    "scipy": "matlab",
    "zenoh": "ros2",
}


class MissingExtra(BadInput, ImportError):
    """Missing optional library. The text names the library, its purpose, and the command that installs it."""


def need(module: str, purpose: str) -> ModuleType:
    """Import a module of an optional library, such as "pyarrow.parquet". Raises MissingExtra.

    purpose : what needs it, as the beginning of a sentence: "a Parquet file"
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        if error.name is None or error.name.partition(".")[0] != package:  # a dependency of the library is missing
            raise MissingExtra(f"{purpose} needs {package}, which cannot be imported ({error})") from None
        # a library that no extra installs
        what = f"'tickwork[{EXTRAS[package]}]'" if package in EXTRAS else package
        raise MissingExtra(f"{purpose} needs {package}: pip install {what}") from None

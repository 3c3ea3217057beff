"""SHA-256 without OpenSSL, which hashlib loads: 4 MB in the memory of a control process."""

from contextlib import suppress
from importlib import import_module
from typing import Any

MODULES = ("_sha2", "_sha256", "hashlib")  # CPython 3.12 and later; before; without either


def sha256(data: bytes) -> Any:
    """Return the hash object of hashlib.sha256. data : what it has consumed"""
    for name in MODULES:
        with suppress(ImportError):
            return import_module(name).sha256(data)
    raise ImportError("no module has SHA-256")

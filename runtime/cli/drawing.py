"""Picture files of commands. A failed drawing leaves no file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.host.errors import BadInput
from runtime.host.replaced_file import replacement
from runtime.record.analysis.pictures import check_ending
from runtime.record.storage.files import create, private

if TYPE_CHECKING:
    from functools import partial


def check(output: Path | None) -> None:
    """Raise BadInput if an output does not end as a picture. output : Path from -o, or None"""
    if output is not None:
        check_ending(output, f"-o {output}")


def write(draw: Callable[..., Any] | partial, output: Path | None, stem: str, suffix: str = ".png") -> str:
    """Write a picture. Returns its path.

    draw : function of a binary file and "png", "svg" or "pdf"
    output : Path from -o, an existing file is replaced; None for a new file: `stem` and `suffix`, with a number in
        between if that exists

    Raises BadInput if the file cannot be written.
    """
    path = None
    try:
        if output is None:
            path, descriptor = create(stem, suffix)
            os.close(descriptor)
        with replacement(output or path or "", private) as file:
            draw(file, Path(output or path or "").suffix[1:])
    except BaseException as error:
        if path is not None:
            Path(path).unlink()
        if isinstance(error, OSError):
            raise BadInput(f"cannot write {output or path or Path(stem).parent}: {error.strerror or error}") from None
        raise
    return str(output or path)

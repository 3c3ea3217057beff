"""Pictures of commands: where they go, and that nothing is left where they cannot be drawn."""

from pathlib import Path

from runtime.base.errors import BadInput
from runtime.recording.files import create, private

KINDS = (".png", ".svg")


def check(output):
    """output : Path that a person has named, or None. BadInput where it is that of no picture"""
    if output is not None and output.suffix not in KINDS:
        raise BadInput(f"-o {output}: a picture ends in {' or '.join(KINDS)}")


def write(draw, output, stem, suffix=".png"):
    """Returns the path.

    draw : called with a file that is open for writing bytes, and "png" or "svg"
    output : Path that a person has named, and is replaced; None for a new one: `stem` and `suffix`, or with a number in
        between where that exists
    """
    try:
        path, descriptor = (str(output), str(output)) if output is not None else create(stem, suffix)
        file = open(descriptor, "wb", opener=private)
    except OSError as error:
        raise BadInput(f"cannot write {output or Path(stem).parent}: {error.strerror}") from None
    try:
        with file:
            draw(file, Path(path).suffix[1:])
    except BaseException as error:
        Path(path).unlink()
        if isinstance(error, OSError):
            raise BadInput(f"cannot write {path}: {error.strerror or error}") from None
        raise
    return path

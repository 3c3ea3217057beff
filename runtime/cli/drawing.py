"""Picture files of commands. A failed drawing leaves no file."""

from pathlib import Path

from runtime.base.errors import BadInput
from runtime.recording.files import create, private

ENDINGS = (".png", ".svg")


def check(output):
    """Raise BadInput if an output does not end in .png or .svg. output : Path from -o, or None"""
    if output is not None and output.suffix not in ENDINGS:
        raise BadInput(f"-o {output}: the name of a picture must end in {' or '.join(ENDINGS)}")


def write(draw, output, stem, suffix=".png"):
    """Write a picture. Returns its path.

    draw : function of a binary file and "png" or "svg"
    output : Path from -o, an existing file is replaced; None for a new file: `stem` and `suffix`, with a number in
        between if that exists

    Raises BadInput if the file cannot be written.
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

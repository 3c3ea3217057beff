"""A laboratory's own package: blocks in Python and native code, a robot, a rig, tests."""

from __future__ import annotations

import keyword
import os
from importlib.util import find_spec
from pathlib import Path
from shutil import rmtree

from graph.sha256 import sha256
from runtime.host.errors import BadInput
from runtime.host.replaced_file import write

TEMPLATES = Path(__file__).parent / "templates"
NAME = "my_lab"  # in the templates
DRIVE_ONLY = "  # with --drive"  # at the end of lines of a package with a device family
FILES = {  # {file of the package: its template}
    ".github/workflows/test.yml": "test.yml",
    ".gitignore": "gitignore",
    "README.md": "README.md",
    "pyproject.toml": "pyproject.toml",
    "setup.py": "setup.py",
    "diagrams/knee.py": "knee.py",
    "rigs/emulated.toml": "emulated.toml",
    "my_lab/__init__.py": "__init__.py",
    "my_lab/blocks.py": "blocks.py",
    "my_lab/kernels.pyx": "kernels.pyx",
    "tests/test_blocks.py": "test_blocks.py",
    "tests/test_knee.py": "test_knee.py",
}
DRIVE_FILES = {
    **{
        f"my_lab/drive/{name}": f"drive_{name}"
        for name in ("__init__.py", "block.py", "emulator.py", "family.py", "kernels.pyx", "models.py", "protocol.py")
    },
    "tests/test_drive.py": "test_drive.py",
}


def create(folder: Path, drive: bool = False) -> list[Path]:
    """Write a package, named like its folder. Returns the paths of its files.

    folder : path that does not exist
    drive : whether it includes a device family, as an example of a drive of the laboratory's own

    Raises BadInput for a name that no package can have, or that another one has, for a folder that exists, and for
    files that cannot be written.
    """
    name = folder.name
    if not name.isascii() or not name.isidentifier() or keyword.iskeyword(name) or name != name.lower():
        raise BadInput(f"{name!r} cannot name a package: use lower-case letters, digits and _, as in my_lab")
    if folder.exists():
        raise BadInput(f"{folder} exists already: choose another name, or remove it")
    if find_spec(name) is not None:
        raise BadInput(f"a package or module {name!r} is installed already: choose another name")
    group = "239.74.{}.{}".format(*sha256(os.fsencode(folder.absolute())).digest())
    files = FILES | DRIVE_FILES if drive else FILES
    paths = [path.replace(NAME, name) for path in files]
    part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        for path, template in zip(paths, files.values()):
            (part / path).parent.mkdir(parents=True, exist_ok=True)
            write(part / path, text(template, name, drive).replace("GROUP", group))
        os.rename(part, folder)
    except BaseException as error:
        rmtree(part, ignore_errors=True)
        if isinstance(error, OSError):
            raise BadInput(f"cannot write {folder}: {error.strerror}") from None
        raise
    return [folder / path for path in paths]


def text(template: str, name: str, drive: bool) -> str:
    """Return the text of a file. template : its name without `.in`; name, drive : as in `create`"""
    lines = (TEMPLATES / f"{template}.in").read_text().replace(NAME, name).splitlines()
    return "".join(f"{line.removesuffix(DRIVE_ONLY)}\n" for line in lines if drive or not line.endswith(DRIVE_ONLY))

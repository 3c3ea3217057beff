"""Hash of the sources of a native module. `setup.py` runs this file, so it imports nothing of the project."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
CIMPORT = re.compile(r"^(?:from )?(cext[\w.]*) cimport|^cimport (cext[\w.]*)", re.M)
DIRECTIVE = r"\s*cython\s*:(?!\s*freethreading_compatible\s*=\s*True\s*$)"  # that changes the C code
COMMENT = re.compile(rf"\s*#(?!define|include|if|else|endif|undef|{DIRECTIVE}).*|^\s*\n", re.M)


def hash_of(source: Path) -> str:
    """Return the hash of a .pyx file and of the .pxd files of this project that it includes, without comments.

    Directives of Cython that change the C code count.
    """
    digest, todo, seen = hashlib.sha256(), [source], set()
    while todo:
        path = todo.pop()
        if path in seen or not path.is_file():
            continue
        seen.add(path)
        text = path.read_text()
        digest.update(COMMENT.sub("", text).encode())
        names = sorted({first or second for first, second in CIMPORT.findall(text)})
        todo += [ROOT.joinpath(*name.split(".")).with_suffix(".pxd") for name in names]
        if path.suffix == ".pyx":
            todo.append(path.with_suffix(".pxd"))
    return digest.hexdigest()[:16]

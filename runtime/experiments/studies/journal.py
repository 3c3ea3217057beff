"""Journal of a study that has not ended: the description and one line of JSON per finished trial."""

from __future__ import annotations

import errno
import fcntl
import json
import os
from pathlib import Path
from typing import Any

from runtime.host.errors import BadInput


class Journal:
    """File of the finished trials, which survives the end of the process at any time.

    path : path of the file, which is created or continued
    identity : description of the study as plain data

    rows : {number of a trial: its row} of earlier processes

    Raises BadInput if the file is damaged or that of another study, or another process is writing it.
    """

    def __init__(self, path: Path, identity: dict[str, Any]) -> None:
        self.path, self.rows, self._empty = path, {}, False
        if not path.parent.is_dir():
            raise BadInput(f"cannot write {path}: create the folder {path.parent} first")
        try:
            self._file = open(path, "a+b", buffering=0)
        except OSError as error:
            raise BadInput(f"cannot write {path}: {error.strerror or error}") from None
        try:
            self._take(identity)
        except BaseException:
            self.close()
            raise

    def _take(self, identity):
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BadInput(f"another process is running this study: it holds {self.path}") from None
        self._file.seek(0)
        data = self._file.read()
        whole = data[: data.rfind(b"\n") + 1]  # without the line during which a process was killed
        head, *lines = whole.splitlines() or [b""]
        self._empty = not lines
        os.ftruncate(self._file.fileno(), 0 if self._empty else len(whole))
        if self._empty:
            self._append(identity)
            return
        try:
            stored = dict(json.loads(head))
            rows = {row["trial"]: row for row in map(json.loads, lines)}
        except (ValueError, KeyError, TypeError):
            raise BadInput(
                f"{self.path} is damaged, or not the file of a study's finished trials: choose another file with -o "
                "(in Python output=), or delete this one"
            ) from None
        check_identity(self.path, stored, identity)
        self.rows.update(rows)

    def write(self, row: dict[str, Any]) -> None:
        """Append a row."""
        self._append(row)
        self._empty = False

    def _append(self, content):
        line = json.dumps(content).encode() + b"\n"
        if self._file.write(line) != len(line):  # else the next row would be appended to a part of this one
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), os.fspath(self.path))

    def close(self) -> None:
        """Close the file, which remains if it has a row."""
        if self._empty and not self._file.closed:
            self.path.unlink(missing_ok=True)
        self._file.close()

    def remove(self) -> None:
        """Close and delete the file."""
        self.path.unlink(missing_ok=True)
        self.close()


def check_identity(path: Path, stored: dict[str, Any], identity: dict[str, Any]) -> None:
    """Raise BadInput if a file is that of another study. stored : the description in the file"""
    plain = json.loads(json.dumps(identity))
    different = [key for key in plain if stored.get(key) != plain[key]]
    if different:
        keys = ", ".join("the diagram file" if key == "source_sha256" else key for key in different)
        raise BadInput(
            f"{path} has the results of another study, which differs in {keys}: choose another file with -o "
            "(in Python output=), or delete this one"
        )

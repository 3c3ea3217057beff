"""Journal of a study that has not ended: the description and one line of JSON per finished trial."""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path
from typing import Any

from runtime.base.errors import BadInput


class Journal:
    """File of the finished trials, which survives the end of the process at any time.

    path : of the file, which is created or continued
    identity : description of the study as plain data

    rows : {number of a trial: its row} of earlier processes

    Raises BadInput if the file is that of another study, or another process is writing it.
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
        check_identity(self.path, json.loads(head), identity)
        for row in map(json.loads, lines):
            self.rows[row["trial"]] = row

    def write(self, row: dict[str, Any]) -> None:
        """Append a row."""
        self._append(row)
        self._empty = False

    def _append(self, content):
        self._file.write(json.dumps(content).encode() + b"\n")

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

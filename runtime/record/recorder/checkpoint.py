"""The progress of a writer, in shared memory that outlives it.

The writer saves a checkpoint, then releases the drained part of the ring. The ring keeps all records after the last
release. The checkpoint whose `tail` equals the tail of the ring therefore holds the complete length of each file and
the first record of the next part: no record is lost or written twice.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress
from typing import Any

from cext.memory.shared_state import SharedState


class Checkpoint:
    """Checkpoints of the writers of one run. shared : cext.memory.shared_state.SharedState"""

    def __init__(self, shared: SharedState) -> None:
        self.shared, self.saves = shared, 0
        self.files = [os.memfd_create("tickwork-checkpoint") for _ in range(2)]  # written in turn

    def __del__(self):
        for file in self.files:
            os.close(file)

    def save(self, state: dict[str, Any]) -> None:
        """Save a state, a dict for JSON, then release the drained part of the ring."""
        file, self.saves = self.files[self.saves % 2], self.saves + 1
        state = {
            **state,
            "tail": self.shared.cursor,
            "dropped": self.shared.statistics()["dropped"],
            "save": self.saves,
        }
        os.ftruncate(file, 0)
        os.pwrite(file, json.dumps(state).encode(), 0)
        self.shared.release()

    def newest(self) -> dict[str, Any] | None:
        """Return the newest state at the tail of the ring, or None. The next save does not overwrite it."""
        states = []
        for file in self.files:
            with suppress(ValueError):  # incomplete when the writer died
                states.append(json.loads(os.pread(file, os.fstat(file).st_size, 0)))
        states = [state for state in states if state["tail"] == self.shared.tail]
        newest = max(states, key=lambda state: state["save"], default=None)
        self.saves = newest["save"] if newest is not None else 0
        return newest

    @staticmethod
    def cut_files(state: dict[str, Any]) -> None:
        """Truncate every file to its complete length."""
        for path, size in state["sizes"].items():
            with suppress(OSError):
                os.truncate(path, size)

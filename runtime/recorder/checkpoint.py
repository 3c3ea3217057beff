"""How far a writer has come, in shared memory: what is left of it when it dies.

The writer saves a checkpoint, then releases the drained part of the ring. The ring keeps everything behind the last
release, so the checkpoint whose `tail` is the ring's names the length at which each file is whole and from which record
on the next part begins: nothing is lost and no record is written twice.
"""

import json
import os
from contextlib import suppress


class Checkpoint:
    """page : cext.safety.shared_state.SharedState, of the ring"""

    def __init__(self, page):
        self.page, self.saves = page, 0
        self.files = [os.memfd_create("tickwork-checkpoint") for _ in range(2)]  # written in turn

    def __del__(self):
        for file in self.files:
            os.close(file)

    def save(self, state):
        """Keep a state, a dict for JSON, then release what has been drained."""
        file, self.saves = self.files[self.saves % 2], self.saves + 1
        state = {**state, "tail": self.page.cursor, "dropped": self.page.statistics()["dropped"], "save": self.saves}
        os.ftruncate(file, 0)
        os.pwrite(file, json.dumps(state).encode(), 0)
        self.page.release()

    def newest(self):
        """The newest state at the ring's tail, None where there is none. The next save keeps it."""
        states = []
        for file in self.files:
            with suppress(ValueError):  # being written when the writer died
                states.append(json.loads(os.pread(file, os.fstat(file).st_size, 0)))
        states = [state for state in states if state["tail"] == self.page.tail]
        newest = max(states, key=lambda state: state["save"], default=None)
        self.saves = newest["save"] if newest is not None else 0
        return newest

    @staticmethod
    def cut_files(state):
        """Cut every file to the length at which it was whole."""
        for path, size in state["sizes"].items():
            with suppress(OSError):
                os.truncate(path, size)

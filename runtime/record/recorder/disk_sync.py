"""Thread that writes the files of a recording to the disk, so that a power cut loses little of them.

The recorder hands its data to the kernel, which can keep it in memory for half a minute. Waiting for the disk takes
long at times; the thread does nothing else, and the recorder never waits for it.
"""

import os
import threading
from collections.abc import Iterable
from contextlib import suppress

SYNC_PERIOD = 1.0  # s


class DiskSync:
    """The thread. paths : paths of the files"""

    def __init__(self, paths: Iterable[str]) -> None:
        self._paths = list(paths)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        for folder in {os.path.dirname(path) or "." for path in self._paths}:
            with suppress(OSError):
                self.sync(folder)  # otherwise a power cut can take the names of new files
        while not self._over.wait(SYNC_PERIOD):
            for path in self._paths:
                with suppress(OSError):  # deleted, or of a file system without it
                    self.sync(path)

    @staticmethod
    def sync(path: str) -> None:
        """Wait until the content of a file or folder is on the disk. Raises OSError."""
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fdatasync(descriptor)
        finally:
            os.close(descriptor)

    def stop(self) -> None:
        """End the thread after the file that it is writing. Does not wait for it."""
        self._over.set()

"""The thread that writes files to the disk."""

import os
import time

from runtime.recorder import disk_sync
from runtime.recorder.disk_sync import DiskSync


def test_files_are_synced_once_a_period_until_it_is_stopped(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(disk_sync, "SYNC_PERIOD", 0.01)
    monkeypatch.setattr(os, "fdatasync", lambda descriptor: synced.append(os.readlink(f"/proc/self/fd/{descriptor}")))
    (tmp_path / "a.mcap").write_bytes(b"x")
    sync = DiskSync([str(tmp_path / "gone.csv"), str(tmp_path / "a.mcap")])
    deadline = time.monotonic() + 10.0
    while len(synced) < 3 and time.monotonic() < deadline:
        time.sleep(0.005)
    sync.stop()
    sync._thread.join(10.0)
    count = len(synced)
    time.sleep(0.05)
    assert count >= 3 and len(synced) == count and set(synced) == {str(tmp_path / "a.mcap")}

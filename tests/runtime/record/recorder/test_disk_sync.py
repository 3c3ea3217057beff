"""When a recorder waits for the disk, and the thread that writes files to it."""

import os
import time

import pytest

from cext.memory.shared_state import SharedState
from runtime.record.recorder import disk_sync
from runtime.record.recorder.disk_sync import DiskSync
from runtime.record.recorder.part import Recording
from tests.runtime.record.recorder.running import CSV, columns, plan, sink


def test_folder_is_synced_once_and_files_once_a_period_until_it_is_stopped(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(disk_sync, "SYNC_PERIOD", 0.01)
    monkeypatch.setattr(os, "fdatasync", lambda descriptor: synced.append(os.readlink(f"/proc/self/fd/{descriptor}")))
    (tmp_path / "a.mcap").write_bytes(b"x")
    sync = DiskSync([str(tmp_path / "gone.csv"), str(tmp_path / "a.mcap")])
    deadline = time.monotonic() + 10.0
    while len(synced) < 4 and time.monotonic() < deadline:
        time.sleep(0.005)
    sync.stop()
    sync._thread.join(10.0)
    count = len(synced)
    time.sleep(0.05)
    assert count >= 4 and len(synced) == count
    assert synced[0] == str(tmp_path) and set(synced[1:]) == {str(tmp_path / "a.mcap")}


@pytest.mark.parametrize(("virtual", "waits"), [(False, {".csv", ".log", ".mcap", ".part"}), (True, set())])
def test_the_end_waits_for_the_disk_in_real_time_alone(tmp_path, monkeypatch, virtual, waits):
    synced = set()
    monkeypatch.setattr(os, "fsync", lambda file: synced.add(os.path.splitext(os.readlink(f"/proc/self/fd/{file}"))[1]))
    can = {"buses": ["legs"], "media": ["can"]}
    shared = SharedState(1 << 16)
    recording = Recording(plan(tmp_path, sink(CSV, "a", columns("a.x m")), virtual=virtual, **can), shared)
    recording.open()
    recording.begin()
    assert recording.finish(orphaned=False)["problems"] == []
    assert len(list(tmp_path.iterdir())) == 4 and synced == waits
